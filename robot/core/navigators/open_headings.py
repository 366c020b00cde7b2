"""Find the smallest turn to an open heading: close sectors around near points, and sweep over them.

The disc of the robot, enlarged by a margin, must be able to move a look-ahead distance along a
heading without meeting a stored point. So each point closes a sector of headings around its
bearing. Sectors are pairs of integers (brads, 4096 to the circle; millimetres), not bins.
"""

from math import sqrt
from typing import Final

from robot.core.perception.echoes import (
    BRADS,
    CIRCLE,
    FIRM_MM,
    HALF_CIRCLE,
    MAX_WEIGHT,
    NOTHING,
    QUARTER,
    SURE,
    Echoes,
    contradicting,
)
from robot.core.perception.people import EACH, PERSON_M, Pedestrians
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Pose, whole_cos_sin
from runtime.elementary import acos, asin, coarse_atan2

NEAR: Final = 24
"""Maximum number of sectors."""
SLICES: Final = 3
FEW: Final = NEAR // SLICES
"""Number of sectors that are compared when one must be replaced."""
LOOK_MM: Final = 200
WIDE_MM: Final = 80
TIGHT_MM: Final = 20
SQUEEZE_MM: Final = -10
"""Margins around the disc of the robot; `ease_mm` reduces all three.

With the negative one the robot also tries a gap that the stored points show too narrow.
"""
CLEAR_MM: Final = 8
"""Distance kept from a firm point that the robot would pass, or graze, without a margin."""
FREE_MM: Final = 1000
WARY_MM: Final = 60
"""A point with a single echo limits the speed as if it were at least this far away."""
DOUBT: Final = 8  # quarters of the spread
WALK_WIDE_MM: Final = 100  # margin for the uncertain position of a pedestrian
WALK_TIGHT_MM: Final = 50
PERSON_MM: Final = int(1000.0 * PERSON_M)
MEET_M: Final = 1.2
SPEED_MM_S: Final = 300
CLOSES_MM: Final = LOOK_MM + WIDE_MM
"""A point farther than this from the robot's rim closes no heading."""
LOOK_MM2: Final = LOOK_MM * LOOK_MM
UNKNOWN: Final = CIRCLE  # no bearing
TABLE: Final = 256
ASIN: Final = tuple([int(BRADS * asin(k / TABLE)) + 1 for k in range(TABLE + 1)])
ACOS: Final = tuple([int(BRADS * acos(k / TABLE)) + 1 for k in range(TABLE + 1)])


class Sectors:
    """Bearings of near points in the odometry frame, and half of the sector that each closes.

    `wide`, `tight` and `squeezed` are half sectors with the margins WIDE_MM, TIGHT_MM and the
    negative SQUEEZE_MM, each less `ease_mm` of `measure`. `point` is the index among the echoes,
    NOTHING for a pedestrian. `away_mm` is the distance of the point from the robot's centre,
    `body_mm` the radius of the robot without a margin, less the spread of the point. `free_mm` is
    the free distance along the robot's heading. A sweep sets `offset` to the turn to each bearing,
    and `closing` to the sector just before the heading it found; `low` and `rest` are its working
    memory.
    """

    __slots__ = (
        "away_mm",
        "bearing",
        "body_mm",
        "closing",
        "count",
        "free_mm",
        "low",
        "offset",
        "point",
        "rest",
        "squeezed",
        "tight",
        "wide",
    )

    def __init__(self) -> None:
        self.count = 0
        self.closing = NOTHING
        self.free_mm = FREE_MM
        self.point = [0] * NEAR
        self.away_mm = [0] * NEAR
        self.body_mm = [0] * NEAR
        self.bearing = [0] * NEAR
        self.offset = [0] * NEAR
        self.low = [0] * NEAR
        self.rest = bytearray(NEAR)
        self.wide = [0] * NEAR
        self.tight = [0] * NEAR
        self.squeezed = [0] * NEAR


def measure(
    sectors: Sectors,
    echoes: Echoes,
    pose: Pose,
    ring: Ring,
    ease_mm: int,
    radius_mm: int,
) -> None:
    """Collect the points that can close headings; `ease_mm` is subtracted from all margins."""
    sectors.count = 0
    sectors.free_mm = FREE_MM
    if echoes.count:
        gather(sectors, echoes, pose, ease_mm, radius_mm)
        shape(sectors)
    if sectors.count:
        close(sectors, sectors.wide, WIDE_MM)
        close(sectors, sectors.tight, TIGHT_MM)
    if ring.pedestrians.any:
        give_way(sectors, ring.pedestrians, radius_mm)


def gather(sectors: Sectors, echoes: Echoes, pose: Pose, ease_mm: int, radius_mm: int) -> None:
    """Collect points within reach, weaken contradicted ones, and update the free distance."""
    heading = int(BRADS * pose.heading_rad)
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    cosine, sine = whole_cos_sin(pose.heading_rad)
    xs, ys, weights, spreads_mm = echoes.x_mm, echoes.y_mm, echoes.weight, echoes.spread_mm
    through_mm2, most_mm2 = echoes.through_mm2, max(echoes.through_mm2)
    reach_mm = LOOK_MM + WIDE_MM + radius_mm
    least_mm, reach_mm2, radius_mm2 = -reach_mm, reach_mm * reach_mm, radius_mm * radius_mm
    most_body_mm = radius_mm - ease_mm
    slim_mm, clear_mm = most_body_mm + SQUEEZE_MM, radius_mm + CLEAR_MM
    for k in range(echoes.count):
        dx_mm = xs[k] - x_mm
        if dx_mm >= reach_mm or dx_mm <= least_mm:
            continue
        dy_mm = ys[k] - y_mm
        square = dx_mm * dx_mm + dy_mm * dy_mm
        if square >= reach_mm2:
            continue
        if square < radius_mm2:
            push_out(echoes, k, x_mm, y_mm, int(sqrt(square)), radius_mm)
            square = radius_mm2
        along_mm = dx_mm * cosine + dy_mm * sine >> 10
        bearing, weight, spread_mm = UNKNOWN, weights[k], spreads_mm[k]
        if square < most_mm2 and along_mm >= 0 and 0 < weight <= MAX_WEIGHT:
            bearing = int(BRADS * coarse_atan2(dy_mm, dx_mm))
            if square < through_mm2[contradicting(bearing - heading, weight)]:
                weights[k] = weight = weight - 1
        body_mm = most_body_mm - (DOUBT * spread_mm >> 2)
        closes_mm = body_mm + CLOSES_MM
        sure = weight >= SURE
        if sure and square < closes_mm * closes_mm:
            keep(sectors, k, dx_mm, dy_mm, square, body_mm, bearing)
        if along_mm > 0:
            aside_mm = abs(dy_mm * cosine - dx_mm * sine >> 10)
            if aside_mm < clear_mm:
                see_ahead(sectors, along_mm, aside_mm, slim_mm, clear_mm, sure, spread_mm)


def keep(
    sectors: Sectors, k: int, dx_mm: int, dy_mm: int, square: int, body_mm: int, bearing: int
) -> None:
    """Store an echo for `shape`; when all sectors are taken, in place of a farther one."""
    n = sectors.count
    if n < NEAR:
        sectors.count = n + 1
    else:
        n = farthest(sectors.away_mm, k % SLICES * FEW)
        if square >= sectors.away_mm[n]:
            return
    sectors.point[n], sectors.away_mm[n], sectors.body_mm[n] = k, square, body_mm
    sectors.bearing[n], sectors.wide[n], sectors.tight[n] = bearing, dx_mm, dy_mm


def see_ahead(
    sectors: Sectors,
    along_mm: int,
    aside_mm: int,
    slim_mm: int,
    clear_mm: int,
    sure: bool,
    spread_mm: int,
) -> None:
    """Update the free distance with the distance at which the robot must stop before a point.

    It stops TIGHT_MM before a point ahead, and CLEAR_MM before a firm one farther aside than half
    its slim width. A point that does not count only slows it down.
    """
    if aside_mm < slim_mm:
        body_mm = clear_mm - CLEAR_MM + TIGHT_MM if sure else slim_mm
    elif sure and spread_mm <= FIRM_MM:
        body_mm = clear_mm
    else:
        return
    free_mm = along_mm - int(sqrt(body_mm * body_mm - aside_mm * aside_mm))
    if not sure and free_mm < WARY_MM:
        free_mm = WARY_MM
    if free_mm < sectors.free_mm:
        sectors.free_mm = free_mm if free_mm > 0 else 0


def push_out(echoes: Echoes, k: int, x_mm: int, y_mm: int, away_mm: int, radius_mm: int) -> None:
    """Move a point out of the robot's disc: its echo came from beyond the rim."""
    if away_mm > 0:
        echoes.x_mm[k] = x_mm + (echoes.x_mm[k] - x_mm) * radius_mm // away_mm
        echoes.y_mm[k] = y_mm + (echoes.y_mm[k] - y_mm) * radius_mm // away_mm


def shape(sectors: Sectors) -> None:
    """Convert the offsets and squared distances left by `gather` to bearings and distances."""
    bearing, away_mm, wide, tight = sectors.bearing, sectors.away_mm, sectors.wide, sectors.tight
    for n in range(sectors.count):
        away_mm[n] = int(sqrt(away_mm[n]))
        if bearing[n] == UNKNOWN:
            bearing[n] = int(BRADS * coarse_atan2(tight[n], wide[n]))


def give_way(sectors: Sectors, pedestrians: Pedestrians, radius_mm: int) -> None:
    """Close the headings along which the robot would meet a pedestrian."""
    for k in EACH:
        if pedestrians.sure[k] and pedestrians.range_m[k] < MEET_M:
            n = sectors.count
            if n < NEAR:
                sectors.count = n + 1
            else:
                n = farthest(sectors.away_mm, k % SLICES * FEW)
            away_mm = radius_mm + max(int(1000.0 * pedestrians.range_m[k]), 0)
            sectors.point[n] = NOTHING
            sectors.away_mm[n] = away_mm
            sectors.body_mm[n] = radius_mm
            middle_mm, body_mm = away_mm + PERSON_MM, radius_mm + PERSON_MM
            bearing = int(BRADS * pedestrians.at_rad[k])
            nears = int(1000.0 * pedestrians.approach_m_s[k])
            across = int(1000.0 * pedestrians.across_m_s[k])
            sine = (body_mm + WALK_TIGHT_MM << 8) // middle_mm
            meet(sectors, n, bearing, sine, nears, across, sectors.tight)
            sine = (body_mm + WALK_WIDE_MM << 8) // middle_mm
            meet(sectors, n, bearing, sine, nears, across, sectors.wide)


def meet(
    sectors: Sectors,
    n: int,
    bearing: int,
    sine: int,
    nears: int,
    across: int,
    halves: "list[int]",
) -> None:
    """Compute the sector of headings on which the robot, at full speed, meets a pedestrian.

    On these headings the robot's motion relative to the pedestrian points at its body. `sine` is
    that of half the angle the body covers, in 256ths. `nears` and `across` are the pedestrian's
    speeds along and across the line of sight in mm/s.
    """
    sine = min(sine, TABLE)
    half, cosine = ASIN[sine], int(sqrt(TABLE * TABLE - sine * sine))
    left = half + arcsine((nears * sine + across * cosine) // SPEED_MM_S)
    right = half + arcsine((nears * sine - across * cosine) // SPEED_MM_S)
    sectors.bearing[n] = bearing + (left - right) // 2
    halves[n] = max(1, min((left + right) // 2, HALF_CIRCLE - 1))


def arcsine(sine: int) -> int:
    """Return the arcsine in brads of a value in 256ths."""
    return -ASIN[min(-sine, TABLE)] if sine < 0 else ASIN[min(sine, TABLE)]


def farthest(away: "list[int]", first: int) -> int:
    """Return the farthest of a few sectors from `first` on; comparing all would take too long."""
    return away.index(max(away[first : first + FEW]), first)


def close(sectors: Sectors, halves: "list[int]", margin_mm: int) -> None:
    """Compute half sectors: headings on which the disc with a margin meets the point in reach."""
    away, body, look_mm, look_mm2 = sectors.away_mm, sectors.body_mm, LOOK_MM, LOOK_MM2
    asins, acoses = ASIN, ACOS
    for k in range(sectors.count):
        away_mm, body_mm = away[k], body[k] + margin_mm
        if away_mm <= body_mm:
            halves[k] = QUARTER
        elif body_mm <= 0 or away_mm >= look_mm + body_mm:
            halves[k] = 0
        else:
            square = (away_mm + body_mm) * (away_mm - body_mm)
            if square <= look_mm2:
                halves[k] = asins[(body_mm << 8) // away_mm]
            else:
                halves[k] = acoses[(square + look_mm2 << 7) // (away_mm * look_mm)]


def squeeze(sectors: Sectors) -> None:
    """Compute the sectors with the negative margin; pedestrians keep the tight one."""
    close(sectors, sectors.squeezed, SQUEEZE_MM)
    if NOTHING in sectors.point:
        for k in range(sectors.count):
            if sectors.point[k] == NOTHING:
                sectors.squeezed[k] = sectors.tight[k]


STEPS: Final = 16
STEP: Final = CIRCLE // STEPS


def closer(sectors: Sectors, heading: int, halves: "list[int]") -> int:
    """Return the nearest sector that closes this heading, or NOTHING."""
    bearing, away_mm = sectors.bearing, sectors.away_mm
    nearest, least_mm = NOTHING, FREE_MM
    across, circle, half_circle = HALF_CIRCLE - heading, CIRCLE, HALF_CIRCLE
    for k in range(sectors.count):
        off, half = (bearing[k] + across) % circle - half_circle, halves[k]
        if off < half and -half < off and away_mm[k] < least_mm:
            nearest, least_mm = k, away_mm[k]
    return nearest


def closed_steps(sectors: Sectors, start: int, halves: "list[int]") -> int:
    """Return a bit for each closed heading among STEPS, the first of which is `start`.

    The same as `closer` for each of them, in one pass over the sectors.
    """
    bearing, away_mm, closed, step = sectors.bearing, sectors.away_mm, 0, STEP
    for k in range(sectors.count):
        half = halves[k]
        if half > 0 and away_mm[k] < FREE_MM:
            middle = bearing[k] - start
            before = (middle - half) // step
            inside = (middle + half - 1) // step - before
            bits = (1 << inside) - 1 << (before + 1 & STEPS - 1)
            closed |= bits | bits >> STEPS
    return closed & (1 << STEPS) - 1


def aim(sectors: Sectors, start: int, side: int) -> None:
    """Compute the turn from `start` towards `side` to the middle of each sector."""
    bearing, offset = sectors.bearing, sectors.offset
    across, circle = -side * start, CIRCLE
    for k in range(sectors.count):
        offset[k] = (side * bearing[k] + across) % circle


def sweep(sectors: Sectors, start: int, side: int, halves: "list[int]") -> int:
    """Return the turn from `start` towards `side` to an open heading; CIRCLE if there is none."""
    aim(sectors, start, side)
    return open_from(sectors, halves, 0, CIRCLE)


def open_from(sectors: Sectors, halves: "list[int]", turn: int, most: int) -> int:
    """Return the turn, from `turn` on, to an open heading; CIRCLE if there is none before `most`.

    The first pass handles the sectors in their order, once around the circle. Sectors that cover
    the heading are done; the others are checked again until none covers the next heading.
    """
    offset, low, rest = sectors.offset, sectors.low, sectors.rest
    count, closing = 0, NOTHING
    circle = CIRCLE
    for k in range(sectors.count):
        half, middle = halves[k], offset[k]
        start, end = middle - half, middle + half
        if end > circle:
            start, end = start - circle, end - circle
        if start < 0 and start + circle < most:
            most = start + circle
        if turn < end:
            if start < turn:
                turn, closing = end, k
            elif start < most:
                low[k], rest[count] = start, k
                count += 1
    before = NOTHING
    while before != turn and turn <= most:
        before, j = turn, 0
        while j < count:
            k = rest[j]
            if low[k] < turn:
                end = low[k] + 2 * halves[k]
                if turn < end:
                    turn, closing = end, k
                count -= 1
                rest[j] = rest[count]
            else:
                j += 1
    sectors.closing = closing
    return turn if turn <= most and turn < CIRCLE else CIRCLE


def room(sectors: Sectors, turn: int, halves: "list[int]") -> int:
    """Return how far headings stay open beyond the one found by the last sweep."""
    offset, least, circle = sectors.offset, HALF_CIRCLE, CIRCLE
    for k in range(sectors.count):
        half = halves[k]
        if half > 0:
            ahead = (offset[k] - half - turn) % circle
            if ahead < least:
                least = ahead
    return least
