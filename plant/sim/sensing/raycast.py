"""Cast the rays of a sonar ring: five in each cone, the nearest echo of a cone counts.

Every surface gives each ray a *nearness*, the inverse of the distance from the robot's centre along
the ray. The largest one belongs to the surface that the ray hits first. With the ray's direction u
and origin o (a disc of centre c and radius r; an edge from a to b; x the cross product):

- disc: p = u.(c - o), q = |c - o|^2 - r^2, nearness (p + sqrt(p^2 - q)) / q;
- edge: n = (o - a) x (b - a), nearness (u x (a - b)) / n, if u x (a - o) >= 0 >= u x (b - o).

Points are turned into the frame of a cone: *along* its axis, and *aside* to the left of it.
"""

from collections.abc import Sequence
from math import inf, pi, radians, sqrt
from typing import Final, TypeAlias

from plant.model.scene import Disc, Pose, Scene
from plant.sim.sensing.surfaces import (
    CONE_RAD,
    SONARS,
    PoseTolerance,
    SeenDisc,
    SeenEdge,
    Surfaces,
)
from runtime.elementary import cos, cos_sin, sin

RAYS_PER_SONAR: Final = 5
RAY_RAD: Final = CONE_RAD / RAYS_PER_SONAR
ORDER: Final = (0, 2, 4, 6, 1, 3, 5, 7)
"""Sonars in the order of a cast: first the early group, then the late group."""

DRIFT: Final = PoseTolerance(way_m=0.2, turn_rad=radians(25.0))
"""Motion of the robot after which the surfaces in sight are selected again."""

MAX_WAY_M2: Final = DRIFT.way_m * DRIFT.way_m
MAX_TURN_RAD: Final = DRIFT.turn_rad
TINY: Final = 1e-12

MISSED: Final = 1.0 + 1e-9
"""The squared distance of a ray from a disc that it misses, over the squared radius, at least."""

COS_1: Final = cos(RAY_RAD)
SIN_1: Final = sin(RAY_RAD)
COS_2: Final = cos(2.0 * RAY_RAD)
SIN_2: Final = sin(2.0 * RAY_RAD)
TAN_MIDWAY_1: Final = sin(0.5 * RAY_RAD) / cos(0.5 * RAY_RAD)
TAN_MIDWAY_2: Final = sin(1.5 * RAY_RAD) / cos(1.5 * RAY_RAD)
"""Between the middle ray and its neighbour; between that and the outermost one."""

Ray: TypeAlias = tuple[float, float]

RIGHT_2: Final[list[Ray]] = [
    (COS_2, -SIN_2),
    (COS_1, -SIN_1),
    (1.0, 0.0),
    (COS_1, SIN_1),
    (COS_2, SIN_2),
]
"""The rays in the frame of their cone, as the ones most to the right meet an edge first."""
RIGHT_1: Final[list[Ray]] = [RIGHT_2[i] for i in (1, 0, 2, 3, 4)]
MIDDLE: Final[list[Ray]] = [RIGHT_2[i] for i in (2, 1, 3, 0, 4)]
LEFT_1: Final[list[Ray]] = [RIGHT_2[i] for i in (3, 4, 2, 1, 0)]
LEFT_2: Final[list[Ray]] = [RIGHT_2[i] for i in (4, 3, 2, 1, 0)]

NUMBERED: Final[list[tuple[int, float, float]]] = [(i, *RIGHT_2[i]) for i in range(RAYS_PER_SONAR)]

Sight: TypeAlias = tuple[float, float, list[SeenDisc], list[SeenEdge]]
"""The axis of a cone in the frame of the robot, and the surfaces that may be in it."""

Cone: TypeAlias = tuple[float, float, float, float, list[float], list[float]]
"""Origin and axis of a cone; per ray, the largest nearness and the cosine of its incidence."""


def ray_bearings_rad() -> tuple[float, ...]:
    """Return the bearings of the rays from the heading, sonars in `ORDER`, evenly spaced."""
    return tuple(
        (sonar - 3.5) * CONE_RAD + (ray - 2) * RAY_RAD
        for sonar in ORDER
        for ray in range(RAYS_PER_SONAR)
    )


class Caster:
    """The view of one ring: the surfaces in sight, and the rays that meet them."""

    def __init__(self, scene: Scene, reach_m: float, incidence_limit_rad: float) -> None:
        """Create a caster; `reach_m` is measured from the centre of the robot."""
        self._surfaces = Surfaces(scene)
        self._reach_m = reach_m
        self._least_cosine = cos(incidence_limit_rad) if incidence_limit_rad < pi / 2 else 0.0
        self._chosen_at = (inf, inf, 0.0)
        self._early: list[Sight] = []
        self._late: list[Sight] = []

    def cast(
        self, early: Pose, late: Pose, moved: tuple[Sequence[Disc], Sequence[Disc]] = ((), ())
    ) -> list[float]:
        """Return the nearness of each sonar's nearest echo, in `ORDER`; zero without one.

        `moved`: positions of the moving discs at the early and at the late ping.
        """
        if self._drifted(late) or self._drifted(early):
            self._choose(late)
        if self._least_cosine > 0.0:
            least_cosine = self._least_cosine
            nearness = cast_facing(self._early, early, moved[0], least_cosine)
            nearness += cast_facing(self._late, late, moved[1], least_cosine)
        else:
            nearness = cast_group(self._early, early, moved[0])
            nearness += cast_group(self._late, late, moved[1])
        return nearness

    def _drifted(self, at: Pose) -> bool:
        """Return whether the pose differs too much from that of the chosen surfaces."""
        x_m, y_m, heading_rad = self._chosen_at
        dx, dy, turned_rad = at[0] - x_m, at[1] - y_m, abs(at[2] - heading_rad)
        if turned_rad > pi:
            turned_rad = 2.0 * pi - turned_rad
        return dx * dx + dy * dy > MAX_WAY_M2 or turned_rad > MAX_TURN_RAD

    def _choose(self, at: Pose) -> None:
        """Select the surfaces in sight."""
        views = self._surfaces.in_sight(at, self._reach_m, DRIFT)
        sights = [
            (cos((sonar - 3.5) * CONE_RAD), sin((sonar - 3.5) * CONE_RAD), *views[sonar])
            for sonar in ORDER
        ]
        self._early, self._late = sights[: SONARS // 2], sights[SONARS // 2 :]
        self._chosen_at = at


def moving_discs(moved: Sequence[Disc]) -> list[SeenDisc]:
    """Return moving discs as candidates that may be arbitrarily near."""
    return [(0.0, x_m, y_m, radius_m, radius_m * radius_m) for x_m, y_m, radius_m in moved]


def cast_group(sights: list[Sight], at: Pose, moved: Sequence[Disc]) -> list[float]:
    """Return the nearness of the nearest surface in each cone of sonars that ping at one pose.

    A disc is nearest along the ray that passes its centre most closely, so one ray suffices.
    """
    x_m, y_m, heading_rad = at
    cosine, sine = cos_sin(heading_rad)
    moving = moving_discs(moved) if moved else None
    found: list[float] = []
    for axis_x, axis_y, discs, edges in sights:
        ux, uy = cosine * axis_x - sine * axis_y, sine * axis_x + cosine * axis_y
        nearest = 0.0
        for least_m, centre_x, centre_y, _, square_m2 in (
            discs if moving is None else moving + discs
        ):
            if nearest * least_m >= 1.0:
                break
            dx, dy = centre_x - x_m, centre_y - y_m
            along, aside = dx * ux + dy * uy, dy * ux - dx * uy
            if aside < 0.0:
                aside = -aside
            if aside <= along * TAN_MIDWAY_1:
                p = along
            elif aside <= along * TAN_MIDWAY_2:
                p = along * COS_1 + aside * SIN_1
            else:
                p = along * COS_2 + aside * SIN_2
            q = dx * dx + dy * dy - square_m2
            excess = p * p - q
            if p > 0.0 and excess >= 0.0:
                near = (p + sqrt(excess)) / (q if q > TINY else TINY)
                if near > nearest:
                    nearest = near
        if edges and nearest * edges[0][0] < 1.0:
            nearest = nearest_edge(edges, x_m, y_m, ux, uy, nearest)
        found.append(nearest)
    return found


def nearest_edge(
    edges: list[SeenEdge], x_m: float, y_m: float, ux: float, uy: float, nearest: float
) -> float:
    """Return the nearness of the nearest edge in a cone, at least `nearest`.

    Of the rays that meet an edge, the one closest to its normal meets it first.
    """
    for least_m, start_x, start_y, end_x, end_y, _ in edges:
        if nearest * least_m >= 1.0:
            break
        ax, ay, bx, by = start_x - x_m, start_y - y_m, end_x - x_m, end_y - y_m
        n = ay * (bx - ax) - ax * (by - ay)
        if n < 0.0:
            continue
        if n < TINY:
            n = TINY
        a_along, a_aside = ax * ux + ay * uy, ay * ux - ax * uy
        b_along, b_aside = bx * ux + by * uy, by * ux - bx * uy
        across, along = a_aside - b_aside, b_along - a_along
        steep = along if along >= 0.0 else -along
        if steep <= across * TAN_MIDWAY_1:
            rays = MIDDLE
        elif steep <= across * TAN_MIDWAY_2:
            rays = LEFT_1 if along > 0.0 else RIGHT_1
        else:
            rays = LEFT_2 if along > 0.0 else RIGHT_2
        for cosine, sine in rays:
            begins = cosine * a_aside - sine * a_along
            ends = sine * b_along - cosine * b_aside
            if begins >= 0.0 and ends >= 0.0:
                near = (begins + ends) / n
                if near > nearest:
                    nearest = near
                break
    return nearest


def cast_facing(
    sights: list[Sight], at: Pose, moved: Sequence[Disc], least_cosine: float
) -> list[float]:
    """Do as `cast_group`, but a ray that grazes its surface has no echo."""
    x_m, y_m, heading_rad = at
    cosine, sine = cos_sin(heading_rad)
    moving = moving_discs(moved)
    found: list[float] = []
    for axis_x, axis_y, discs, edges in sights:
        ux, uy = cosine * axis_x - sine * axis_y, sine * axis_x + cosine * axis_y
        nearest, facing = [0.0] * RAYS_PER_SONAR, [0.0] * RAYS_PER_SONAR
        cone = x_m, y_m, ux, uy, nearest, facing
        meet_discs(moving + discs, cone)
        meet_edges(edges, cone)
        echo = 0.0
        for i in range(RAYS_PER_SONAR):
            if facing[i] >= least_cosine and nearest[i] > echo:
                echo = nearest[i]
        found.append(echo)
    return found


def meet_discs(discs: list[SeenDisc], cone: Cone) -> None:
    """Update the rays of a cone that meet a disc."""
    x_m, y_m, ux, uy, nearest, facing = cone
    all_nearer = min(nearest)
    for least_m, centre_x, centre_y, radius_m, square_m2 in discs:
        if all_nearer * least_m >= 1.0:
            break
        dx, dy = centre_x - x_m, centre_y - y_m
        along, aside = dx * ux + dy * uy, dy * ux - dx * uy
        beyond = (aside if aside >= 0.0 else -aside) * COS_2 - along * SIN_2
        if beyond > 0.0 and beyond * beyond > square_m2 * MISSED:
            continue
        q = dx * dx + dy * dy - square_m2
        is_nearer = False
        for i, cosine, sine in NUMBERED:
            p = along * cosine + aside * sine
            excess = p * p - q
            if p > 0.0 and excess >= 0.0:
                root = sqrt(excess)
                near = (p + root) / (q if q > TINY else TINY)
                if near > nearest[i]:
                    nearest[i], facing[i], is_nearer = near, root / radius_m, True
        if is_nearer:
            all_nearer = min(nearest)


def meet_edges(edges: list[SeenEdge], cone: Cone) -> None:
    """Update the rays of a cone that meet an edge."""
    x_m, y_m, ux, uy, nearest, facing = cone
    all_nearer = min(nearest)
    for least_m, start_x, start_y, end_x, end_y, length_m in edges:
        if all_nearer * least_m >= 1.0:
            break
        ax, ay, bx, by = start_x - x_m, start_y - y_m, end_x - x_m, end_y - y_m
        n = ay * (bx - ax) - ax * (by - ay)
        if n < 0.0:
            continue
        a_along, a_aside = ax * ux + ay * uy, ay * ux - ax * uy
        b_along, b_aside = bx * ux + by * uy, by * ux - bx * uy
        is_nearer = False
        for i, cosine, sine in NUMBERED:
            begins = cosine * a_aside - sine * a_along
            ends = sine * b_along - cosine * b_aside
            if begins >= 0.0 and ends >= 0.0:
                near = (begins + ends) / (n if n > TINY else TINY)
                if near > nearest[i]:
                    nearest[i], facing[i], is_nearer = near, (begins + ends) / length_m, True
        if is_nearer:
            all_nearer = min(nearest)
