"""A short memory of where echoes came from: at most 96 points in the odometry frame.

A cone says how far the nearest surface in it is, not at which bearing. So a point carries with it
how far aside of the middle of its cone the surface may have been (`spread_mm`); a later echo from
nearer by narrows that. Points count once an echo has confirmed them, and go when a longer echo
passes through the place, when they are not seen again for long, or when they are far away.
"""

from math import atan2, cos, pi, sin, sqrt

from robot.core.geometry import BEARINGS, COSINES, HALF_CONE, SINES, wrap
from robot.core.parameters import Params
from robot.core.ring import Ring
from robot.core.typed import Final
from robot.core.values import SONARS, Pose

POINTS: Final = 96
REACH_M: Final = 0.75
"""Echoes from farther away are not remembered."""
FORGET_M: Final = 1.0
SURE: Final = 2
"""Points with at least this weight count."""
MOST_WEIGHT: Final = 4
NEVER: Final = -1

SAME_M: Final = 0.035
SAME_SHARE: Final = 0.02
THROUGH_M: Final = 0.07
THROUGH_SHARE: Final = 0.03
CORE_RAD: Final = 0.8 * HALF_CONE
ASIDE: Final = 0.235  # tan of half a cone and two degrees
SPREAD: Final = 0.1  # half of tan of half a cone
LEANING: Final = 0.6
SLANT: Final = 2.1
EDGE_RAD: Final = 0.75 * HALF_CONE
COS_EDGE: Final = cos(EDGE_RAD)
SIN_EDGE: Final = sin(EDGE_RAD)
FINER: Final = 0.7
SLICES: Final = 4
FADE_TICKS: Final = 120
CONE: Final = 2.0 * HALF_CONE


class Echoes:
    """Points `x_mm`, `y_mm` with weight and spread, the first `count` of them in use.

    `last` is per sonar the point that its last echo belonged to; `turn` counts ticks.
    """

    __slots__ = ("count", "last", "pose", "spread_mm", "turn", "weight", "x_mm", "y_mm")

    def __init__(self) -> None:
        self.x_mm = [0] * POINTS
        self.y_mm = [0] * POINTS
        self.weight = [0] * POINTS
        self.spread_mm = [0] * POINTS
        self.last = [NEVER] * SONARS
        self.count = 0
        self.turn = 0
        self.pose: Pose | None = None


def clear(echoes: Echoes) -> None:
    echoes.count = 0
    echoes.pose = None
    for i in range(SONARS):
        echoes.last[i] = NEVER


def update(echoes: Echoes, pose: Pose, ring: Ring, params: Params) -> None:
    """Take this tick's ring; even sonars were pinged half a period before the odd ones."""
    before = echoes.pose
    if before is None:
        before = pose
    echoes.pose = pose
    echoes.turn += 1
    if echoes.count:
        fade(echoes, pose, ring, params)
    if ring.nearest_m >= REACH_M:
        return
    turned_rad = wrap(pose.heading_rad - before.heading_rad)
    middle = Pose(
        0.5 * (pose.x_m + before.x_m),
        0.5 * (pose.y_m + before.y_m),
        before.heading_rad + 0.5 * turned_rad,
    )
    for first in (0, 1):
        at = pose if first else middle
        cosine, sine = cos(at.heading_rad), sin(at.heading_rad)
        for i in range(first, SONARS, 2):
            range_m = ring.range_m[i]
            if range_m is None or range_m >= REACH_M:
                echoes.last[i] = NEVER
                continue
            along_x = cosine * COSINES[i] - sine * SINES[i]
            along_y = sine * COSINES[i] + cosine * SINES[i]
            lean = leaning(ring, i, range_m, params.radius_m)
            take(echoes, i, lean, at, along_x, along_y, range_m, params.radius_m)


def leaning(ring: Ring, sonar: int, range_m: float, radius_m: float) -> int:
    """On which side of its cone an echo lies: 1 left, -1 right, 0 in the middle or unknown.

    Where a neighbour sees the same surface nearer, this cone meets it at the edge next to that.
    """
    away_m = range_m + radius_m
    right_m = left_m = None
    if sonar > 0:
        right_m = ring.range_m[sonar - 1]
    if sonar < SONARS - 1:
        left_m = ring.range_m[sonar + 1]
    right_nearer = (
        right_m is not None and right_m < range_m and away_m < SLANT * (right_m + radius_m)
    )
    left_nearer = left_m is not None and left_m < range_m and away_m < SLANT * (left_m + radius_m)
    if left_nearer == right_nearer:
        return 0
    return 1 if left_nearer else -1


def take(
    echoes: Echoes,
    sonar: int,
    lean: int,
    at: Pose,
    along_x: float,
    along_y: float,
    range_m: float,
    radius_m: float,
) -> None:
    """One echo: confirm the point it comes from, or remember a new one."""
    away_m = range_m + radius_m
    tolerance_m = SAME_M + SAME_SHARE * range_m
    spread_mm = int(1000.0 * (SPREAD if lean == 0 else LEANING * SPREAD) * range_m) + 1
    x_mm, y_mm = 1000.0 * at.x_m, 1000.0 * at.y_m
    low_mm, high_mm = 1000.0 * (away_m - tolerance_m), 1000.0 * (away_m + tolerance_m)
    xs, ys = echoes.x_mm, echoes.y_mm
    found = echoes.last[sonar]
    if (
        found == NEVER
        or found >= echoes.count
        or not within(xs[found] - x_mm, ys[found] - y_mm, along_x, along_y, low_mm, high_mm)
    ):
        found = NEVER
        for k in range(echoes.count):
            dx_mm, dy_mm = xs[k] - x_mm, ys[k] - y_mm
            along_mm = dx_mm * along_x + dy_mm * along_y
            if low_mm * 0.97 <= along_mm <= high_mm and within(
                dx_mm, dy_mm, along_x, along_y, low_mm, high_mm
            ):
                found = k
                break
    if found == NEVER:
        if lean:
            along_x, along_y = (
                COS_EDGE * along_x - lean * SIN_EDGE * along_y,
                COS_EDGE * along_y + lean * SIN_EDGE * along_x,
            )
        echoes.last[sonar] = insert(
            echoes,
            int(x_mm + 1000.0 * away_m * along_x),
            int(y_mm + 1000.0 * away_m * along_y),
            spread_mm,
            x_mm,
            y_mm,
        )
        return
    echoes.last[sonar] = found
    if echoes.weight[found] < MOST_WEIGHT:
        echoes.weight[found] += 1
    if spread_mm < FINER * echoes.spread_mm[found]:
        dx_mm, dy_mm = xs[found] - x_mm, ys[found] - y_mm
        stretch = 1000.0 * away_m / sqrt(dx_mm * dx_mm + dy_mm * dy_mm)
        xs[found] = int(x_mm + stretch * dx_mm)
        ys[found] = int(y_mm + stretch * dy_mm)
        echoes.spread_mm[found] = spread_mm


def within(
    dx_mm: float, dy_mm: float, along_x: float, along_y: float, low_mm: float, high_mm: float
) -> bool:
    """Whether a place lies in the cone and at the distance of its echo."""
    along_mm = dx_mm * along_x + dy_mm * along_y
    aside_mm = dy_mm * along_x - dx_mm * along_y
    if not -ASIDE * along_mm <= aside_mm <= ASIDE * along_mm:
        return False
    square = along_mm * along_mm + aside_mm * aside_mm
    return low_mm * low_mm <= square <= high_mm * high_mm


def insert(
    echoes: Echoes, x_mm: int, y_mm: int, spread_mm: int, here_x_mm: float, here_y_mm: float
) -> int:
    """A new point; when there is no room the farthest one goes."""
    k = echoes.count
    if k < POINTS:
        echoes.count += 1
    else:
        k, far = 0, -1.0
        for j in range(POINTS):
            dx_mm, dy_mm = echoes.x_mm[j] - here_x_mm, echoes.y_mm[j] - here_y_mm
            square = dx_mm * dx_mm + dy_mm * dy_mm
            if square > far:
                k, far = j, square
    echoes.x_mm[k] = x_mm
    echoes.y_mm[k] = y_mm
    echoes.weight[k] = 1
    echoes.spread_mm[k] = spread_mm
    return k


def drop(echoes: Echoes, k: int) -> None:
    """Forget a point; the last one takes its place."""
    echoes.count -= 1
    last = echoes.count
    echoes.x_mm[k] = echoes.x_mm[last]
    echoes.y_mm[k] = echoes.y_mm[last]
    echoes.weight[k] = echoes.weight[last]
    echoes.spread_mm[k] = echoes.spread_mm[last]


def fade(echoes: Echoes, pose: Pose, ring: Ring, params: Params) -> None:
    """Look at a quarter of the points: drop the far ones, weaken those an echo passes through."""
    x_mm, y_mm = 1000.0 * pose.x_m, 1000.0 * pose.y_m
    far = 1e6 * FORGET_M * FORGET_M
    old = echoes.turn % FADE_TICKS < SLICES
    k = echoes.count - 1 - echoes.turn % SLICES
    while k >= 0:
        dx_mm, dy_mm = echoes.x_mm[k] - x_mm, echoes.y_mm[k] - y_mm
        square = dx_mm * dx_mm + dy_mm * dy_mm
        if square > far:
            drop(echoes, k)
        else:
            if old:
                echoes.weight[k] -= 1
            bearing_rad = wrap(atan2(dy_mm, dx_mm) - pose.heading_rad)
            if -0.5 * pi < bearing_rad < 0.5 * pi:
                sonar = int((bearing_rad + 0.5 * pi) / CONE)
                range_m = ring.range_m[sonar]
                off_rad = bearing_rad - BEARINGS[sonar]
                if range_m is not None and -CORE_RAD < off_rad < CORE_RAD:
                    here_m = 0.001 * sqrt(square) - params.radius_m
                    if (
                        range_m < 9.0 and here_m < range_m - THROUGH_M - THROUGH_SHARE * range_m
                    ) or (range_m > 9.0 and echoes.weight[k] < SURE):
                        echoes.weight[k] -= 1
            if echoes.weight[k] <= 0:
                drop(echoes, k)
        k -= SLICES
