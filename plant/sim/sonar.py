"""A ring of eight sonars: converts the nearest surfaces into readings in millimetres.

Even sonars ping half a period before the stamp of the scan, odd ones at the stamp. Each cone has
five rays; its nearest echo counts. Every surface gives each ray a *nearness*, the inverse of the
distance from the robot's centre along the ray. The largest one belongs to the surface that the ray
hits first. With the ray's direction u and origin o (a disc of centre c and radius r; an edge from a
to b; x the cross product):

- disc: p = u.(c - o), q = |c - o|^2 - r^2, nearness (p + sqrt(p^2 - q)) / q;
- edge: n = (o - a) x (b - a), nearness (u x (a - b)) / n, if u x (a - o) >= 0 >= u x (b - o).

Points are turned into the frame of a cone: *along* its axis, and *aside* to the left of it. Only
surfaces that a sonar may see near a pose are cast. This skips only surfaces that cannot matter:
rounding in it never changes an echo.
"""

from collections.abc import Sequence
from math import floor, inf, pi, radians, sqrt
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from plant.model.configuration import Body, Noise
from plant.model.geometry import Disc, Edge, Pose, StaticScene
from plant.sim.active_faults import SonarFaults
from plant.sim.seeds import gaussian_rows, uniform_rows
from protocol.ring import ALL_SONARS, BEARINGS_RAD, CONE_RAD, SONARS
from runtime.elementary import cos, cos_sin, sin

HALF_TURN_RAD: Final = pi
FULL_TURN_RAD: Final = 2.0 * pi
SLACK_M: Final = 1e-6
"""Added to every selection, far more than its rounding errors."""

BEARING_ERROR_RAD: Final = 0.006
"""Largest error of `rough_bearing_rad`."""

NEAR_M: Final = 1.0
"""Surfaces of the whole scene are looked at again after this way."""

LEAST_M2: Final = 1e-300
"""Keeps the division by the square of a length of zero possible."""

SeenDisc: TypeAlias = tuple[float, float, float, float, float]
"""Smallest distance from the ring, centre, radius, and its square."""

SeenEdge: TypeAlias = tuple[float, float, float, float, float, float]
"""Smallest distance from the ring, start, end, and length."""

View: TypeAlias = tuple[list[SeenDisc], list[SeenEdge]]
"""What one sonar may see, the nearest first."""


class PoseTolerance(NamedTuple):
    """Largest distance from a pose, and largest turn in either direction."""

    way_m: float
    turn_rad: float


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

    def in_sight(self, at: Pose, reach_m: float, drift: PoseTolerance) -> list[View]:
        """Return what each sonar may see within reach of a ring, at all poses within `drift`."""
        dx, dy = at[0] - self._near_at[0], at[1] - self._near_at[1]
        if not dx * dx + dy * dy <= NEAR_M * NEAR_M:
            self._look_around(at, reach_m)
        views: list[View] = [([], []) for _ in range(SONARS)]
        way_m, turn_rad = drift.way_m + SLACK_M, drift.turn_rad + BEARING_ERROR_RAD
        add_discs(views, self._discs, at, reach_m, way_m, turn_rad)
        add_edges(views, self._edges, at, reach_m, way_m, turn_rad)
        for seen_discs, seen_edges in views:
            seen_discs.sort()
            seen_edges.sort()
        return views

    def _look_around(self, at: Pose, reach_m: float) -> None:
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
        self._near_at = at[:2]


def add_discs(
    views: list[View], discs: list[Disc], at: Pose, reach_m: float, way_m: float, turn_rad: float
) -> None:
    """Add to each view the discs that its sonar may see."""
    x_m, y_m, heading_rad = at
    cosine, sine = cos_sin(heading_rad)
    for centre_x, centre_y, radius_m in discs:
        dx, dy = centre_x - x_m, centre_y - y_m
        away_m, wide_m = sqrt(dx * dx + dy * dy), radius_m + way_m
        if away_m - wide_m >= reach_m:
            continue
        seen = (away_m - wide_m, centre_x, centre_y, radius_m, radius_m * radius_m)
        bearing_rad = rough_bearing_rad(dx * cosine + dy * sine, dy * cosine - dx * sine)
        half_rad = half_width_rad(wide_m, away_m) + turn_rad
        for sonar in sonars_between(bearing_rad - half_rad, bearing_rad + half_rad):
            views[sonar][0].append(seen)


def add_edges(
    views: list[View], edges: list[Edge], at: Pose, reach_m: float, way_m: float, turn_rad: float
) -> None:
    """Add to each view the edges that its sonar may see, from their visible side."""
    x_m, y_m, heading_rad = at
    cosine, sine = cos_sin(heading_rad)
    for start_x, start_y, end_x, end_y in edges:
        ax, ay, bx, by = start_x - x_m, start_y - y_m, end_x - x_m, end_y - y_m
        span_x, span_y = bx - ax, by - ay
        square_m2 = span_x * span_x + span_y * span_y
        length_m = sqrt(square_m2)
        if ay * span_x - ax * span_y < -way_m * length_m:
            continue
        share = -(ax * span_x + ay * span_y) / square_m2 if square_m2 > 0.0 else 0.0
        share = 0.0 if share < 0.0 else 1.0 if share > 1.0 else share
        foot_x, foot_y = ax + share * span_x, ay + share * span_y
        least_m = sqrt(foot_x * foot_x + foot_y * foot_y) - way_m
        if least_m >= reach_m:
            continue
        left_rad, right_rad = FULL_TURN_RAD, 0.0
        if least_m > 0.0:
            left_rad = rough_bearing_rad(ax * cosine + ay * sine, ay * cosine - ax * sine)
            right_rad = rough_bearing_rad(bx * cosine + by * sine, by * cosine - bx * sine)
            if left_rad < right_rad:
                left_rad += FULL_TURN_RAD
            left_rad += half_width_rad(way_m, sqrt(ax * ax + ay * ay)) + turn_rad
            right_rad -= half_width_rad(way_m, sqrt(bx * bx + by * by)) + turn_rad
        for sonar in sonars_between(right_rad, left_rad):
            views[sonar][1].append((least_m, start_x, start_y, end_x, end_y, length_m))


def sonars_between(right_rad: float, left_rad: float) -> list[int]:
    """Return the sonars whose cones reach into a sector, given from right to left."""
    first, last = floor(right_rad / CONE_RAD) + 4, floor(left_rad / CONE_RAD) + 4
    if last > first + 15:
        last = first + 15
    return [cone & 7 for cone in range(first, last + 1) if cone & 8 == 0]


def half_width_rad(wide_m: float, away_m: float) -> float:
    """Return at least half the angle of a disc at a distance: x + 0.571 x^3 is above asin x."""
    if wide_m >= away_m:
        return HALF_TURN_RAD
    x = wide_m / away_m
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
        reach_m, least_cosine = self._reach_m, self._least_cosine
        if least_cosine > 0.0:
            nearness = cast_facing(self._early, early, moved[0], reach_m, least_cosine)
            nearness += cast_facing(self._late, late, moved[1], reach_m, least_cosine)
        else:
            nearness = cast_group(self._early, early, moved[0], reach_m)
            nearness += cast_group(self._late, late, moved[1], reach_m)
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
            (cos(BEARINGS_RAD[sonar]), sin(BEARINGS_RAD[sonar]), *views[sonar]) for sonar in ORDER
        ]
        self._early, self._late = sights[: SONARS // 2], sights[SONARS // 2 :]
        self._chosen_at = at


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


def cast_group(sights: list[Sight], at: Pose, moved: Sequence[Disc], reach_m: float) -> list[float]:
    """Return the nearness of the nearest surface in each cone of sonars that ping at one pose.

    A disc is nearest along the ray that passes its centre most closely, so one ray suffices.
    """
    x_m, y_m, heading_rad = at
    cosine, sine = cos_sin(heading_rad)
    moving = moving_discs(moved, at, reach_m) if moved else None
    found: list[float] = []
    for axis_x, axis_y, discs, edges in sights:
        ux, uy = cosine * axis_x - sine * axis_y, sine * axis_x + cosine * axis_y
        nearest = nearest_disc(moving, x_m, y_m, ux, uy, 0.0) if moving else 0.0
        if discs and nearest * discs[0][0] < 1.0:
            nearest = nearest_disc(discs, x_m, y_m, ux, uy, nearest)
        if edges and nearest * edges[0][0] < 1.0:
            nearest = nearest_edge(edges, x_m, y_m, ux, uy, nearest)
        found.append(nearest)
    return found


def nearest_disc(
    discs: list[SeenDisc], x_m: float, y_m: float, ux: float, uy: float, nearest: float
) -> float:
    """Return the nearness of the nearest disc in a cone, at least `nearest`."""
    for least_m, centre_x, centre_y, _, square_m2 in discs:
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
    return nearest


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
    sights: list[Sight], at: Pose, moved: Sequence[Disc], reach_m: float, least_cosine: float
) -> list[float]:
    """Do as `cast_group`, but a ray that grazes its surface has no echo."""
    x_m, y_m, heading_rad = at
    cosine, sine = cos_sin(heading_rad)
    moving = moving_discs(moved, at, reach_m)
    found: list[float] = []
    for axis_x, axis_y, discs, edges in sights:
        ux, uy = cosine * axis_x - sine * axis_y, sine * axis_x + cosine * axis_y
        nearest, facing = [0.0] * RAYS_PER_SONAR, [0.0] * RAYS_PER_SONAR
        cone = x_m, y_m, ux, uy, nearest, facing
        meet_discs(moving, cone)
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
        for place in range(SONARS):
            sonar, near = ORDER[place], nearness[place]
            chance = chances[sonar]
            if chance < untrue:
                if chance < self._lost:
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
