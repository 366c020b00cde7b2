"""A short memory of echoes: at most 64 points in the odometry frame.

A cone gives the distance of the nearest surface, not its bearing. So a point has a `spread_mm`, by
which the surface may be aside of it; a later echo at a shorter range reduces that. A point counts
once a second echo has confirmed it, or at once if its echo was near. A saturated range is stored as
0, at the rim: the surface may touch the robot. A point is dropped when longer echoes pass through
it, when it is not confirmed for long, or when it is far away.

Millimetres and brads (4096 to the circle) as integers cost a third of floats on the MCU.
"""

from math import pi, sqrt
from typing import Final

from robot.core.perception.sonar_ring import AHEAD, SATURATED_M, Ring
from robot.core.ring import BEARINGS, HALF_CONE, SONARS
from robot.core.values import EVERY, Pose, whole_cos_sin
from runtime.elementary import coarse_atan2, cos, sin

POINTS: Final = 64
SURE: Final = 2
"""Minimum weight of a point that counts."""
MAX_WEIGHT: Final = 4
FIRM_MM: Final = 16
FIRM_STEP: Final = 4
FIRM_WEIGHT: Final = 16
"""A point with a spread of at most FIRM_MM is firm: it counts at once and outlasts longer echoes.

The end of a thin wall returns few echoes, and longer ones pass it on both sides. So each echo adds
FIRM_STEP to the weight, up to FIRM_WEIGHT.
"""
NOISE_MM: Final = 12
BEYOND: Final = 8
"""Two distances of a firm point that differ by at most NOISE_MM are averaged.

An echo that is nearer by more counts alone. One that is longer by more comes rather from a surface
beside or behind a wall's end, and moves the point by one part in BEYOND.
"""
NOTHING: Final = -1

CIRCLE: Final = 4096
HALF_CIRCLE: Final = 2048
QUARTER: Final = 1024
BRADS: Final = CIRCLE / (2.0 * pi)
CONE: Final = HALF_CIRCLE // SONARS

REACH_M: Final = 0.75
"""Echoes from farther away are not stored."""
NEAR_M: Final = 0.25
"""Of every ring the nearest echo and those ahead are stored, if they are nearer than this."""
SAME_MM: Final = 35
ASIDE: Final = 240  # 1024 times the tangent of half a cone and two degrees
SPREAD: Final = 10  # half the tangent of half a cone, in hundredths
SPREAD_LEANING: Final = 6
SLANT: Final = 2.1
FEW: Final = 8
"""Number of points that are compared when one of them must be replaced."""

EDGE_RAD: Final = 0.75 * HALF_CONE
DIRECTIONS: Final = tuple([(int(1024 * cos(b)), int(1024 * sin(b))) for b in BEARINGS])
"""Direction of each sonar in the robot's frame, scaled to 1024."""
COS_EDGE: Final = int(1024 * cos(EDGE_RAD))
SIN_EDGE: Final = int(1024 * sin(EDGE_RAD))


class Echoes:
    """Points `x_mm`, `y_mm` with weight and spread; the first `count` are in use.

    `last` is the point of each sonar's last echo; `next` is where to replace a point next. For
    `echo_decay`, `turn` counts its calls. A point is contradicted if its squared distance is below
    `through_mm2` of the sonar that looks there; the last entry is for bearings without a sonar.
    """

    __slots__ = (
        "count",
        "last",
        "next",
        "spread_mm",
        "through_mm2",
        "turn",
        "weight",
        "x_mm",
        "y_mm",
    )

    def __init__(self) -> None:
        self.x_mm = [0] * POINTS
        self.y_mm = [0] * POINTS
        self.weight = bytearray(POINTS)
        self.spread_mm = bytearray(POINTS)
        self.through_mm2 = [0] * (SONARS + 1)
        self.last = [NOTHING] * SONARS
        self.count = 0
        self.turn = self.next = 0


def clear(echoes: Echoes) -> None:
    """Forget every point."""
    echoes.count = 0
    for i in EVERY:
        echoes.last[i] = NOTHING


def record(echoes: Echoes, before: Pose, pose: Pose, ring: Ring, radius_mm: int) -> None:
    """Store the echoes of a ring.

    The odd sonars were pinged now, the even ones halfway from the pose `before`, one tick ago.
    """
    if ring.nearest_m < REACH_M:
        record_group(echoes, 1, SONARS, pose, ring, radius_mm)
        record_group(echoes, 0, SONARS, halfway(before, pose), ring, radius_mm)


def record_nearest(echoes: Echoes, before: Pose, pose: Pose, ring: Ring, radius_mm: int) -> None:
    """Store only the nearest echo of a ring and those ahead, if they are near.

    It costs an eighth to three eighths. Beside a followed wall the nearest echo is the wall's; the
    end of a thin wall ahead returns few, and none of them may be left out.
    """
    range_m, nearest = ring.range_m, ring.nearest
    if ring.nearest_m >= NEAR_M:
        return
    record_one(echoes, nearest, before, pose, ring, radius_mm)
    for i in AHEAD:
        ahead_m = range_m[i]
        if i != nearest and ahead_m is not None and ahead_m < NEAR_M:
            record_one(echoes, i, before, pose, ring, radius_mm)


def record_one(
    echoes: Echoes, sonar: int, before: Pose, pose: Pose, ring: Ring, radius_mm: int
) -> None:
    """Store the echo of one sonar."""
    pinged = pose if sonar % 2 else halfway(before, pose)
    record_group(echoes, sonar, sonar + 1, pinged, ring, radius_mm)


def halfway(before: Pose, pose: Pose) -> "tuple[float, float, float]":
    """Return the pose halfway between two; a plain tuple costs a fifth of a named one."""
    x_m, y_m, heading_rad = pose
    before_x_m, before_y_m, before_rad = before
    turned_rad = (heading_rad - before_rad + pi) % (2.0 * pi) - pi
    return 0.5 * (x_m + before_x_m), 0.5 * (y_m + before_y_m), heading_rad - 0.5 * turned_rad


def record_group(
    echoes: Echoes,
    first: int,
    end: int,
    pose: "tuple[float, float, float]",
    ring: Ring,
    radius_mm: int,
) -> None:
    """Store the echoes of every second sonar of a range, pinged at this pose."""
    x_m, y_m, heading_rad = pose
    cosine, sine = whole_cos_sin(heading_rad)
    x_mm, y_mm = int(1000.0 * x_m), int(1000.0 * y_m)
    for i in range(first, end, 2):
        range_m = ring.range_m[i]
        if range_m is None or range_m >= REACH_M:
            echoes.last[i] = NOTHING
            continue
        ahead, aside = DIRECTIONS[i]
        along_x = cosine * ahead - sine * aside >> 10
        along_y = sine * ahead + cosine * aside >> 10
        lean = leaning(ring, i, range_m, radius_mm)
        range_mm = int(1000.0 * range_m) if range_m >= SATURATED_M else 0
        take(echoes, i, lean, x_mm, y_mm, along_x, along_y, range_mm, radius_mm)


def leaning(ring: Ring, sonar: int, range_m: float, radius_mm: int) -> int:
    """Return the side of the cone on which an echo lies: 1 left, -1 right, 0 middle or unknown.

    If a neighbour measures the same surface nearer, this cone meets it at the edge next to that
    neighbour.
    """
    least_m = (range_m + 0.001 * radius_mm) / SLANT - 0.001 * radius_mm
    lean = 0
    if sonar > 0:
        right_m = ring.range_m[sonar - 1]
        if right_m is not None and least_m < right_m < range_m:
            lean = -1
    if sonar < SONARS - 1:
        left_m = ring.range_m[sonar + 1]
        if left_m is not None and least_m < left_m < range_m:
            lean += 1
    return lean


def take(
    echoes: Echoes,
    sonar: int,
    lean: int,
    x_mm: int,
    y_mm: int,
    along_x: int,
    along_y: int,
    range_mm: int,
    radius_mm: int,
) -> None:
    """Take one echo: confirm the point it comes from, or store a new one."""
    away_mm = range_mm + radius_mm
    slack_mm = SAME_MM + range_mm // 50
    spread_mm = range_mm * (SPREAD_LEANING if lean else SPREAD) // 100 + 1
    found = find(echoes, sonar, x_mm, y_mm, along_x, along_y, away_mm, slack_mm)
    if found == NOTHING:
        if lean:
            along_x, along_y = (
                COS_EDGE * along_x - lean * SIN_EDGE * along_y >> 10,
                COS_EDGE * along_y + lean * SIN_EDGE * along_x >> 10,
            )
        found = vacant(echoes, x_mm, y_mm)
        echoes.x_mm[found] = x_mm + (away_mm * along_x >> 10)
        echoes.y_mm[found] = y_mm + (away_mm * along_y >> 10)
        echoes.weight[found] = FIRM_STEP if spread_mm <= FIRM_MM else 1
        echoes.spread_mm[found] = spread_mm
    else:
        confirm(echoes, found)
        if 10 * spread_mm < 7 * echoes.spread_mm[found]:
            correct(echoes, found, x_mm, y_mm, away_mm, False)
            echoes.spread_mm[found] = spread_mm
        elif spread_mm <= FIRM_MM:
            correct(echoes, found, x_mm, y_mm, away_mm, True)
    echoes.last[sonar] = found


def correct(echoes: Echoes, k: int, x_mm: int, y_mm: int, away_mm: int, is_firm: bool) -> None:
    """Move a point along the line of sight to the measured distance, a firm one part of the way."""
    dx_mm, dy_mm = echoes.x_mm[k] - x_mm, echoes.y_mm[k] - y_mm
    now_mm = int(sqrt(dx_mm * dx_mm + dy_mm * dy_mm)) or 1
    more_mm, part = away_mm - now_mm, 1
    if is_firm and more_mm >= -NOISE_MM:
        part = 2 if more_mm <= NOISE_MM else BEYOND
    echoes.x_mm[k] += dx_mm * more_mm // (part * now_mm)
    echoes.y_mm[k] += dy_mm * more_mm // (part * now_mm)


def confirm(echoes: Echoes, k: int) -> None:
    """Add weight to a point; more to one whose place is known well."""
    weight = echoes.weight[k]
    if echoes.spread_mm[k] <= FIRM_MM:
        if weight < FIRM_WEIGHT:
            weight += FIRM_STEP
            echoes.weight[k] = FIRM_WEIGHT if weight > FIRM_WEIGHT else weight
    elif weight < MAX_WEIGHT:
        echoes.weight[k] = weight + 1


def find(
    echoes: Echoes,
    sonar: int,
    x_mm: int,
    y_mm: int,
    along_x: int,
    along_y: int,
    away_mm: int,
    slack_mm: int,
) -> int:
    """Return the point in the cone at the echo's distance, first that of the last echo."""
    xs, ys, count = echoes.x_mm, echoes.y_mm, echoes.count
    # Such a point is at most this far from the middle of the arc, along either axis.
    reach_mm = slack_mm + away_mm * ASIDE // 1000
    low_x = x_mm + (away_mm * along_x >> 10) - reach_mm
    low_y = y_mm + (away_mm * along_y >> 10) - reach_mm
    high_x, high_y = low_x + 2 * reach_mm, low_y + 2 * reach_mm
    near_mm, far_mm = away_mm - slack_mm, away_mm + slack_mm
    nearest, farthest = near_mm * near_mm, far_mm * far_mm
    last = echoes.last[sonar]
    if 0 <= last < count and low_x < xs[last] < high_x and low_y < ys[last] < high_y:
        dx_mm, dy_mm = xs[last] - x_mm, ys[last] - y_mm
        if fits(dx_mm, dy_mm, along_x, along_y, nearest, farthest):
            return last
    for k in range(count):
        at_mm = xs[k]
        if low_x < at_mm and at_mm < high_x:
            dx_mm, at_mm = at_mm - x_mm, ys[k]
            if (
                low_y < at_mm
                and at_mm < high_y
                and fits(dx_mm, at_mm - y_mm, along_x, along_y, nearest, farthest)
            ):
                return k
    return NOTHING


def fits(dx_mm: int, dy_mm: int, along_x: int, along_y: int, nearest: int, farthest: int) -> bool:
    """Return whether a point lies in the cone and between two squared distances."""
    along_mm = dx_mm * along_x + dy_mm * along_y >> 10
    aside_mm = dy_mm * along_x - dx_mm * along_y
    if not -ASIDE * along_mm <= aside_mm <= ASIDE * along_mm:
        return False
    aside_mm >>= 10
    return nearest <= along_mm * along_mm + aside_mm * aside_mm <= farthest


def vacant(echoes: Echoes, x_mm: int, y_mm: int) -> int:
    """Return a free index, or that of the farthest of the next few points."""
    k = echoes.count
    if k < POINTS:
        echoes.count += 1
        return k
    first = echoes.next
    echoes.next = (first + FEW) % POINTS
    k, far = first, NOTHING
    for j in range(first, first + FEW):
        dx_mm, dy_mm = echoes.x_mm[j] - x_mm, echoes.y_mm[j] - y_mm
        square = dx_mm * dx_mm + dy_mm * dy_mm
        if square > far:
            k, far = j, square
    return k


def put(echoes: Echoes, x_mm: int, y_mm: int, weight: int) -> None:
    """Store a point without an echo."""
    k = vacant(echoes, x_mm, y_mm)
    echoes.x_mm[k], echoes.y_mm[k] = x_mm, y_mm
    echoes.weight[k], echoes.spread_mm[k] = weight, 1


def drop(echoes: Echoes, k: int) -> None:
    """Drop a point; the last one takes its index."""
    echoes.count -= 1
    last = echoes.count
    echoes.x_mm[k] = echoes.x_mm[last]
    echoes.y_mm[k] = echoes.y_mm[last]
    echoes.weight[k] = echoes.weight[last]
    echoes.spread_mm[k] = echoes.spread_mm[last]


CORE: Final = 102  # 0.8 of half a cone
CORE_FROM: Final = CONE // 2 - CORE
CORE_TO: Final = CONE // 2 + CORE
FORGET_MM2: Final = 900 * 900
THROUGH_MM: Final = 70
SLICES: Final = 2
"""Number of slices of the points; one slice is checked at a time."""
FADE_TURNS: Final = 40
"""All points lose weight once in this many turns."""


def fade(echoes: Echoes, pose: Pose) -> None:
    """Check one slice of the points.

    Far points are dropped. Points that an echo passes through lose weight and, once in FADE_TURNS,
    all points do.
    """
    echoes.turn = turn = (echoes.turn + 1) % FADE_TURNS
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    heading = int(BRADS * pose.heading_rad)
    xs, ys, weight = echoes.x_mm, echoes.y_mm, echoes.weight
    through_mm2 = echoes.through_mm2
    most_mm2 = max(through_mm2)
    old = turn < SLICES
    for k in range(echoes.count - 1 - turn % SLICES, -1, -SLICES):
        dx_mm, dy_mm = xs[k] - x_mm, ys[k] - y_mm
        square = dx_mm * dx_mm + dy_mm * dy_mm
        if square > FORGET_MM2:
            drop(echoes, k)
            continue
        weaker = old
        if square < most_mm2:
            bearing = int(BRADS * coarse_atan2(dy_mm, dx_mm)) - heading
            weaker = weaker or square < through_mm2[contradicting(bearing, weight[k])]
        if weaker and weight[k]:
            weight[k] -= 1
        if weight[k] == 0:
            drop(echoes, k)


def update_through(echoes: Echoes, ring: Ring, radius_mm: int) -> None:
    """Update the distance up to which each sonar contradicts stored points.

    No echo contradicts nothing: a wall at an oblique angle returns none.
    """
    if echoes.count == 0:
        return
    through_mm2, range_m = echoes.through_mm2, ring.range_m
    for i in EVERY:
        echo_m = range_m[i]
        if echo_m is None or echo_m > 9.0:
            through_mm2[i] = 0
        else:
            through_mm = int(970.0 * echo_m) - THROUGH_MM + radius_mm
            through_mm2[i] = through_mm * through_mm if through_mm > 0 else 0


def contradicting(bearing: int, weight: int) -> int:
    """Return the sonar whose longer echo contradicts a point, or NOTHING.

    It is the one whose inner cone contains the bearing in brads. The two front sonars contradict
    no single echo: the end of a thin wall returns few among longer ones, and lies in the way.
    """
    from_right = (bearing + QUARTER) % CIRCLE
    if from_right < HALF_CIRCLE and CORE_FROM < from_right % CONE < CORE_TO:
        sonar = from_right // CONE
        if weight >= SURE or sonar not in AHEAD:
            return sonar
    return NOTHING
