"""A ring of eight sonars: converts the nearest surfaces into readings in millimetres.

Even sonars ping half a period before the stamp of the scan, odd ones at the stamp. Each cone has
five rays; its nearest echo counts. Every surface gives each ray a *nearness*, the inverse of the
distance from the robot's centre along the ray. The largest one belongs to the surface that the ray
hits first. With the ray's direction u and origin o (a disc of centre c and radius r; an edge from a
to b; x the cross product):

- disc: p = u.(c - o), q = |c - o|^2 - r^2, nearness (p + sqrt(p^2 - q)) / q;
- edge: n = (o - a) x (b - a), nearness (u x (a - b)) / n, if u x (a - o) >= 0 >= u x (b - o).

Points are turned into the frame of a cone: *along* its axis, and *aside* to the left of it. Only
surfaces that a cone in its direction may meet near a place are cast, the nearest first. This skips
only surfaces that cannot matter: rounding in it never changes an echo.
"""

from collections.abc import Sequence
from math import floor, inf, pi, sqrt
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from plant.model.configuration import Body, Noise
from plant.model.geometry import Disc, Edge, Pose, StaticScene
from plant.sim.active_faults import SonarFaults
from plant.sim.seeds import gaussian_rows, uniform_rows
from protocol.ring import ALL_SONARS, BEARINGS_RAD, CONE_RAD, SONARS
from protocol.world import Point
from runtime.elementary import cos, cos_sin, sin

HALF_TURN_RAD: Final = pi
SLACK_M: Final = 1e-6
"""Added to every selection, far more than its rounding errors."""

BEARING_ERROR_RAD: Final = 0.006
"""Largest error of `rough_bearing_rad`."""

NEAR_M: Final = 1.0
"""Surfaces of the whole scene are looked at again after this way."""

WAY_M: Final = 0.2
"""The surfaces in each direction are selected again after this way."""

LEAST_M2: Final = 1e-300
"""Keeps the division by the square of a length of zero possible."""

DIRECTIONS: Final = 32
STEPS_PER_CONE: Final = 2
STEP_RAD: Final = CONE_RAD / STEPS_PER_CONE
"""A view lies counter-clockwise from a multiple of STEP_RAD, and is a step wider than a cone: it
contains each cone that begins within the first step."""

SeenDisc: TypeAlias = tuple[float, float, float, float, float]
"""Distance from the place of the selection, centre, radius, and its square."""

SeenEdge: TypeAlias = tuple[float, float, float, float, float, float]
"""Distance from the place of the selection, start, end, and length."""

View: TypeAlias = tuple[list[SeenDisc], list[SeenEdge]]
"""What a cone in some direction may meet, the nearest first."""


class Surfaces:
    """Every surface of a scene, and those near the robot."""

    def __init__(self, scene: StaticScene) -> None:
        self._scene = scene
        discs = np.array(scene.discs, dtype=float).reshape(-1, 3)
        edges = np.array(scene.edges, dtype=float).reshape(-1, 4)
        starts = np.concatenate([discs[:, :2], edges[:, :2]])
        ends = np.concatenate([discs[:, :2], edges[:, 2:]])
        self._x, self._y = starts.T
        self._along_x, self._along_y = (ends - starts).T
        squares = self._along_x * self._along_x + self._along_y * self._along_y
        self._squares = np.maximum(squares, LEAST_M2)
        self._radii = np.concatenate([discs[:, 2], np.zeros(len(edges))])
        self._near_at = (np.inf, np.inf)
        self._discs: list[Disc] = []
        self._edges: list[Edge] = []

    def in_sight(self, at: Point, reach_m: float) -> list[View]:
        """Return what is within reach in each direction, from all places within WAY_M."""
        dx, dy = at[0] - self._near_at[0], at[1] - self._near_at[1]
        if not dx * dx + dy * dy <= NEAR_M * NEAR_M:
            self._look_around(at, reach_m)
        discs: list[list[SeenDisc]] = [[] for _ in range(DIRECTIONS)]
        edges: list[list[SeenEdge]] = [[] for _ in range(DIRECTIONS)]
        add_discs(discs * 2, self._discs, at, reach_m)
        add_edges(edges * 2, self._edges, at, reach_m)
        return list(zip(discs, edges, strict=True))

    def _look_around(self, at: Point, reach_m: float) -> None:
        """Select the surfaces near the robot; with numpy, because a map may have thousands."""
        x, y, along_x, along_y = self._x - at[0], self._y - at[1], self._along_x, self._along_y
        shares = -(x * along_x + y * along_y) / self._squares
        shares = np.minimum(np.maximum(shares, 0.0), 1.0)
        x, y = x + shares * along_x, y + shares * along_y
        near = np.sqrt(x * x + y * y) - self._radii < reach_m + 2.0 * NEAR_M
        chosen: list[int] = np.flatnonzero(near).tolist()
        discs, edges = self._scene
        self._discs = [discs[i] for i in chosen if i < len(discs)]
        self._edges = [edges[i - len(discs)] for i in chosen if i >= len(discs)]
        self._near_at = at


def add_discs(around: list[list[SeenDisc]], discs: list[Disc], at: Point, reach_m: float) -> None:
    """Add the discs to the views from which they may be met; `around`: all views, twice.

    All views share one tuple of a disc: the compiler would make one for each of them, if it knew
    the type of the elements of `boxed`.
    """
    x_m, y_m = at
    seen: list[SeenDisc] = []
    for centre_x, centre_y, radius_m in discs:
        dx, dy = centre_x - x_m, centre_y - y_m
        least_m = sqrt(dx * dx + dy * dy) - radius_m
        if least_m < reach_m + WAY_M:
            seen.append((least_m, centre_x, centre_y, radius_m, radius_m * radius_m))
    seen.sort()
    boxed: list[Any] = seen[:]
    for k, (least_m, centre_x, centre_y, radius_m, _) in enumerate(seen):
        bearing_rad = rough_bearing_rad(centre_x - x_m, centre_y - y_m)
        half_rad = half_width_rad(radius_m + WAY_M, least_m + radius_m)
        first, count = sector(bearing_rad - half_rad, bearing_rad + half_rad)
        for i in range(first, first + count):
            around[i].append(boxed[k])


def add_edges(around: list[list[SeenEdge]], edges: list[Edge], at: Point, reach_m: float) -> None:
    """Add the edges to the views from which their visible side may be met."""
    x_m, y_m = at
    seen: list[SeenEdge] = []
    for start_x, start_y, end_x, end_y in edges:
        ax, ay, span_x, span_y = start_x - x_m, start_y - y_m, end_x - start_x, end_y - start_y
        square_m2 = span_x * span_x + span_y * span_y
        length_m = sqrt(square_m2)
        if ay * span_x - ax * span_y < -(WAY_M + SLACK_M) * length_m:
            continue
        share = -(ax * span_x + ay * span_y) / square_m2 if square_m2 > 0.0 else 0.0
        share = 0.0 if share < 0.0 else 1.0 if share > 1.0 else share
        foot_x, foot_y = ax + share * span_x, ay + share * span_y
        least_m = sqrt(foot_x * foot_x + foot_y * foot_y)
        if least_m < reach_m + WAY_M:
            seen.append((least_m, start_x, start_y, end_x, end_y, length_m))
    seen.sort()
    boxed: list[Any] = seen[:]
    for k, (least_m, start_x, start_y, end_x, end_y, _) in enumerate(seen):
        first, count = 0, DIRECTIONS
        if least_m > WAY_M + SLACK_M:
            ax, ay, bx, by = start_x - x_m, start_y - y_m, end_x - x_m, end_y - y_m
            right_rad, left_rad = rough_bearing_rad(bx, by), rough_bearing_rad(ax, ay)
            if left_rad < right_rad:
                left_rad += 2.0 * HALF_TURN_RAD
            left_rad += half_width_rad(WAY_M, sqrt(ax * ax + ay * ay))
            right_rad -= half_width_rad(WAY_M, sqrt(bx * bx + by * by))
            first, count = sector(right_rad, left_rad)
        for i in range(first, first + count):
            around[i].append(boxed[k])


def sector(right_rad: float, left_rad: float) -> tuple[int, int]:
    """Return the first of the views that reach into a sector, and their number."""
    first = floor((right_rad - BEARING_ERROR_RAD) / STEP_RAD) - STEPS_PER_CONE
    count = floor((left_rad + BEARING_ERROR_RAD) / STEP_RAD) + 1 - first
    return first % DIRECTIONS, count if count < DIRECTIONS else DIRECTIONS


def half_width_rad(wide_m: float, away_m: float) -> float:
    """Return at least half the angle of a disc at a distance: x + 0.571 x^3 is above asin x."""
    if wide_m + SLACK_M >= away_m:
        return HALF_TURN_RAD
    x = (wide_m + SLACK_M) / away_m
    return x + 0.571 * x * x * x


def rough_bearing_rad(along: float, aside: float) -> float:
    """Return the direction of a point within `BEARING_ERROR_RAD`."""
    size, across = (along if along >= 0.0 else -along), (aside if aside >= 0.0 else -aside)
    if size >= across:
        x = across / size if size > 0.0 else 0.0
        angle_rad = x * (0.97239411 - 0.19194795 * x * x)
    else:
        x = size / across
        angle_rad = 0.5 * HALF_TURN_RAD - x * (0.97239411 - 0.19194795 * x * x)
    if along < 0.0:
        angle_rad = HALF_TURN_RAD - angle_rad
    return angle_rad if aside >= 0.0 else -angle_rad


RAYS_PER_SONAR: Final = 5
RAY_RAD: Final = CONE_RAD / RAYS_PER_SONAR
ORDER: Final = (0, 2, 4, 6, 1, 3, 5, 7)
"""Sonars in the order of a cast: first the early group, then the late group."""

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

Axis: TypeAlias = tuple[float, float, int]
"""Direction of a sonar from the heading, and the steps of its cone's right edge from the right."""

AXES: Final[list[Axis]] = [
    (cos(BEARINGS_RAD[sonar]), sin(BEARINGS_RAD[sonar]), sonar * STEPS_PER_CONE) for sonar in ORDER
]
EARLY: Final[list[Axis]] = AXES[: SONARS // 2]
LATE: Final[list[Axis]] = AXES[SONARS // 2 :]

Cone: TypeAlias = tuple[float, float, float, float, float, list[float], list[float]]
"""Origin and axis of a cone, way from the place of the selection; per ray, the largest nearness and
the cosine of its incidence."""


def ray_bearings_rad() -> tuple[float, ...]:
    """Return the bearings of the rays from the heading, sonars in `ORDER`, evenly spaced."""
    return tuple(
        BEARINGS_RAD[sonar] + (ray - 2) * RAY_RAD
        for sonar in ORDER
        for ray in range(RAYS_PER_SONAR)
    )


class Caster:
    """The view of one ring: the surfaces in sight, and the rays that meet them."""

    def __init__(self, scene: StaticScene, reach_m: float, incidence_limit_rad: float) -> None:
        """Create a caster; `reach_m` is measured from the centre of the robot."""
        self._surfaces = Surfaces(scene)
        self._reach_m = reach_m
        self._least_cosine = cos(incidence_limit_rad) if incidence_limit_rad < pi / 2 else 0.0
        self._at = (inf, inf)
        self._views: list[View] = []

    def cast(
        self, early: Pose, late: Pose, moved: tuple[Sequence[Disc], Sequence[Disc]] = ((), ())
    ) -> list[float]:
        """Return the nearness of each sonar's nearest echo, in `ORDER`; zero without one.

        `moved`: positions of the moving discs at the early and at the late ping.
        """
        early_m, late_m = self._gone_m(early), self._gone_m(late)
        if not (early_m <= WAY_M and late_m <= WAY_M):
            self._at = late[:2]
            self._views = self._surfaces.in_sight(self._at, self._reach_m)
            early_m, late_m = self._gone_m(early), self._gone_m(late)
        views, least_cosine, reach_m = self._views, self._least_cosine, self._reach_m
        moving_early = moving_discs(moved[0], early, reach_m) if moved[0] else []
        moving_late = moving_discs(moved[1], late, reach_m) if moved[1] else []
        if least_cosine > 0.0:
            nearness = cast_facing(EARLY, views, early, early_m, moving_early, least_cosine)
            nearness += cast_facing(LATE, views, late, late_m, moving_late, least_cosine)
        else:
            nearness = cast_group(EARLY, views, early, early_m, moving_early)
            nearness += cast_group(LATE, views, late, late_m, moving_late)
        return nearness

    def _gone_m(self, at: Pose) -> float:
        """Return at least the way from the place of the selection."""
        dx, dy = at[0] - self._at[0], at[1] - self._at[1]
        return sqrt(dx * dx + dy * dy) + SLACK_M


def moving_discs(moved: Sequence[Disc], at: Pose, reach_m: float) -> list[SeenDisc]:
    """Return the moving discs within reach, the nearest first."""
    x_m, y_m, _ = at
    found: list[SeenDisc] = []
    for centre_x, centre_y, radius_m in moved:
        dx, dy = centre_x - x_m, centre_y - y_m
        least_m = sqrt(dx * dx + dy * dy) - radius_m - SLACK_M
        if least_m < reach_m:
            found.append((least_m, centre_x, centre_y, radius_m, radius_m * radius_m))
    found.sort()
    return found


def first_view(heading_rad: float) -> int:
    """Return the view for a cone that begins a quarter turn to the right of a heading."""
    return floor((heading_rad - 0.5 * HALF_TURN_RAD) / STEP_RAD)


def cast_group(
    axes: list[Axis], views: list[View], at: Pose, gone_m: float, moving: list[SeenDisc]
) -> list[float]:
    """Return the nearness of the nearest surface in each cone of sonars that ping at one pose.

    `gone_m`: way from the place of the selection, by which every surface may have come nearer.
    """
    x_m, y_m, heading_rad = at
    cosine, sine = cos_sin(heading_rad)
    first = first_view(heading_rad)
    found: list[float] = []
    for axis_x, axis_y, steps in axes:
        ux, uy = cosine * axis_x - sine * axis_y, sine * axis_x + cosine * axis_y
        discs, edges = views[(first + steps) % DIRECTIONS]
        nearest = nearest_disc(moving, x_m, y_m, ux, uy, 0.0, 0.0) if moving else 0.0
        if discs:
            nearest = nearest_disc(discs, x_m, y_m, ux, uy, gone_m, nearest)
        if edges and nearest * (edges[0][0] - gone_m) < 1.0:
            nearest = nearest_edge(edges, x_m, y_m, ux, uy, gone_m, nearest)
        found.append(nearest)
    return found


def nearest_disc(
    discs: list[SeenDisc],
    x_m: float,
    y_m: float,
    ux: float,
    uy: float,
    gone_m: float,
    nearest: float,
) -> float:
    """Return the nearness of the nearest disc in a cone, at least `nearest`.

    A disc is nearest along the ray that passes its centre most closely, so one ray suffices.
    """
    for least_m, centre_x, centre_y, radius_m, square_m2 in discs:
        if nearest * (least_m - gone_m) >= 1.0:
            break
        dx, dy = centre_x - x_m, centre_y - y_m
        along, aside = dx * ux + dy * uy, dy * ux - dx * uy
        if aside < 0.0:
            aside = -aside
        if aside <= along * TAN_MIDWAY_1:
            p = along
        elif aside <= along * TAN_MIDWAY_2:
            p = along * COS_1 + aside * SIN_1
        elif aside * COS_2 - along * SIN_2 > radius_m + SLACK_M:
            continue
        else:
            p = along * COS_2 + aside * SIN_2
        q = dx * dx + dy * dy - square_m2
        excess = p * p - q
        if excess >= 0.0 and p > 0.0:
            near = (p + sqrt(excess)) / (q if q > TINY else TINY)
            if near > nearest:
                nearest = near
    return nearest


def nearest_edge(
    edges: list[SeenEdge],
    x_m: float,
    y_m: float,
    ux: float,
    uy: float,
    gone_m: float,
    nearest: float,
) -> float:
    """Return the nearness of the nearest edge in a cone, at least `nearest`.

    Of the rays that meet an edge, the one closest to its normal meets it first.
    """
    for least_m, start_x, start_y, end_x, end_y, _ in edges:
        if nearest * (least_m - gone_m) >= 1.0:
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
    axes: list[Axis],
    views: list[View],
    at: Pose,
    gone_m: float,
    moving: list[SeenDisc],
    least_cosine: float,
) -> list[float]:
    """Do as `cast_group`, but a ray that grazes its surface has no echo."""
    x_m, y_m, heading_rad = at
    cosine, sine = cos_sin(heading_rad)
    first = first_view(heading_rad)
    found: list[float] = []
    for axis_x, axis_y, steps in axes:
        ux, uy = cosine * axis_x - sine * axis_y, sine * axis_x + cosine * axis_y
        discs, edges = views[(first + steps) % DIRECTIONS]
        nearest, facing = [0.0] * RAYS_PER_SONAR, [0.0] * RAYS_PER_SONAR
        meet_discs(moving, (x_m, y_m, ux, uy, 0.0, nearest, facing))
        cone = x_m, y_m, ux, uy, gone_m, nearest, facing
        meet_discs(discs, cone)
        meet_edges(edges, cone)
        echo = 0.0
        for i in range(RAYS_PER_SONAR):
            if facing[i] >= least_cosine and nearest[i] > echo:
                echo = nearest[i]
        found.append(echo)
    return found


def meet_discs(discs: list[SeenDisc], cone: Cone) -> None:
    """Update the rays of a cone that meet a disc."""
    x_m, y_m, ux, uy, gone_m, nearest, facing = cone
    all_nearer = min(nearest)
    for least_m, centre_x, centre_y, radius_m, square_m2 in discs:
        if all_nearer * (least_m - gone_m) >= 1.0:
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
    x_m, y_m, ux, uy, gone_m, nearest, facing = cone
    all_nearer = min(nearest)
    for least_m, start_x, start_y, end_x, end_y, length_m in edges:
        if all_nearer * (least_m - gone_m) >= 1.0:
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


EARLY_US: Final = 25_000
PING_AGE_US: Final = tuple(0 if sonar % 2 else EARLY_US for sonar in range(SONARS))

ROUNDING: Final = float(3 * 2**51)
"""A number plus this minus this is rounded as by `round`, which would dominate the ring's cost."""


class SonarReading(NamedTuple):
    """Range per sonar in millimetres (0 without an echo), and bit fields; bit i is sonar i."""

    range_mm: tuple[int, ...]
    valid: int
    echo: int


SILENT: Final = SonarReading((0,) * SONARS, ALL_SONARS, 0)


class SimulatedSonarRing:
    """Convert the nearest surface in each cone into readings, with noise and faults."""

    def __init__(self, body: Body, noise: Noise, seed: int, robot: int) -> None:
        self._rim_m = body.radius_m
        self._least_m, self._most_m = body.sonar_min_m, body.sonar_max_m
        self._least_nearness = 1.0 / (body.sonar_max_m + body.radius_m)
        self._least_mm, self._most_mm = round(self._least_m * 1e3), round(self._most_m * 1e3)
        self._sigma_m, self._sigma_ratio = noise.range_sigma_m, noise.range_sigma_ratio
        self._lost = noise.dropout_probability
        self._untrue = noise.dropout_probability + noise.ghost_probability
        self._errors = gaussian_rows(seed, robot, "sonar range", SONARS)
        self._chances = uniform_rows(seed, robot, "sonar echo", SONARS)
        self._ghosts = uniform_rows(seed, robot, "sonar ghost", SONARS)
        self._fault_chances = uniform_rows(seed, robot, "sonar fault", SONARS)
        self._last = SILENT

    def read(self, nearness: list[float], trouble: SonarFaults | None) -> SonarReading:
        """Return one scan; `nearness` per sonar in the order of `raycast.ORDER`."""
        reading = self._measured(nearness)
        if trouble is not None:
            reading = self._disturbed(reading, trouble)
        self._last = reading
        return reading

    def _measured(self, nearness: list[float]) -> SonarReading:
        errors, chances, ghosts = self._errors.next(), self._chances.next(), self._ghosts.next()
        range_mm = [0] * SONARS
        echo = 0
        least_nearness, rim_m, most_m = self._least_nearness, self._rim_m, self._most_m
        least_mm, most_mm, untrue = self._least_mm, self._most_mm, self._untrue
        sigma_m, sigma_ratio = self._sigma_m, self._sigma_ratio
        for place, sonar in enumerate(ORDER):
            near = nearness[place]
            if chances[sonar] < untrue:
                if chances[sonar] < self._lost:
                    continue
                range_m = 1.0 / near - rim_m if near >= least_nearness else most_m
                range_m = self._least_m + ghosts[sonar] * (range_m - self._least_m)
            elif near >= least_nearness:
                range_m = 1.0 / near - rim_m
                range_m += errors[sonar] * (sigma_m + sigma_ratio * range_m)
            else:
                continue
            # Comparisons: min() and max() would dominate the cost of the ring.
            read_mm = int(range_m * 1e3 + ROUNDING - ROUNDING)
            if read_mm > most_mm:
                read_mm = most_mm
            range_mm[sonar] = read_mm if read_mm > least_mm else least_mm
            echo |= 1 << sonar
        return SonarReading(tuple(range_mm), ALL_SONARS, echo)

    def _disturbed(self, reading: SonarReading, trouble: SonarFaults) -> SonarReading:
        range_mm, valid, echo = list(reading.range_mm), reading.valid, reading.echo
        chances = self._fault_chances.next()
        for sonar in range(SONARS):
            bit = 1 << sonar
            offset_m, fixed_m = trouble.offset_m[sonar], trouble.fixed_m[sonar]
            dropout = trouble.dropout[sonar]
            if offset_m is not None and echo & bit:
                range_mm[sonar] = _within(range_mm[sonar] + round(offset_m * 1e3))
            if dropout is not None and chances[sonar] < dropout:
                range_mm[sonar], echo = 0, echo & ~bit
            if fixed_m is not None:
                range_mm[sonar], echo = _within(round(fixed_m * 1e3)), echo | bit
            if trouble.frozen[sonar]:
                range_mm[sonar] = self._last.range_mm[sonar]
                echo = (echo & ~bit) | (self._last.echo & bit)
            if trouble.dead[sonar]:
                range_mm[sonar], valid, echo = 0, valid & ~bit, echo & ~bit
        return SonarReading(tuple(range_mm), valid, echo)


def _within(range_mm: int) -> int:
    """Limit a range to the wire field; a faulty sonar has no other limit."""
    return max(0, min(65535, range_mm))
