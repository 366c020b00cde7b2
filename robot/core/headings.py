"""Which headings are open: every near point closes a sector, and a sweep finds the next free one.

The disc of the robot, grown by a margin, must be able to move a look-ahead along a heading without
meeting a remembered point. So a point closes the sector of headings around its bearing for which
it does not. Sectors are integers (brads, 4096 to the circle; millimetres), not bins.
"""

from math import acos, asin, atan2, cos, sin, sqrt

from robot.core.echoes import (
    BRADS,
    CIRCLE,
    HALF_CIRCLE,
    NOTHING,
    QUARTER,
    REACH_M,
    SURE,
    Echoes,
    passed_through,
)
from robot.core.geometry import BEARINGS
from robot.core.ring import Ring
from robot.core.typed import Final
from robot.core.values import SONARS, Pose

NEAR: Final = 28
"""At most this many sectors at a time."""
PASSES: Final = 6
LOOK_MM: Final = 200
WIDE_MM: Final = 80
TIGHT_MM: Final = 20
SQUEEZE_MM: Final = -10
FREE_MM: Final = 1000
WARY_MM: Final = 60
"""What only one echo has told of slows the robot down as if it were no nearer than this."""
DOUBT: Final = 8  # quarters of the spread
WALK_S: Final = 1.5
TABLE: Final = 256
ASIN: Final = tuple([int(BRADS * asin(k / TABLE)) + 1 for k in range(TABLE + 1)])
ACOS: Final = tuple([int(BRADS * acos(k / TABLE)) + 1 for k in range(TABLE + 1)])


class Sectors:
    """Bearings of what is near, in the odometry frame, and half the sector that it closes: with a
    wide margin, with a tight one and, once worked out, with none.

    `point` is its index among the echoes, NOTHING for somebody who walks. `free_mm` is how far the
    robot could drive on along its heading. A sweep leaves `closing`, the sector that closes the
    heading just before the one it found.
    """

    __slots__ = (
        "away_mm",
        "bearing",
        "body_mm",
        "closing",
        "count",
        "free_mm",
        "offset",
        "point",
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
        self.wide = [0] * NEAR
        self.tight = [0] * NEAR
        self.squeezed = [0] * NEAR


def measure(
    sectors: Sectors, echoes: Echoes, pose: Pose, ring: Ring, ease_mm: int, radius_mm: int
) -> None:
    """Collect what is near enough to close anything; `ease_mm` is taken off every margin."""
    sectors.count = 0
    sectors.free_mm = FREE_MM
    reach_mm = LOOK_MM + WIDE_MM + radius_mm
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    heading = int(BRADS * pose.heading_rad)
    cosine, sine = int(1024.0 * cos(pose.heading_rad)), int(1024.0 * sin(pose.heading_rad))
    xs, ys, weight = echoes.x_mm, echoes.y_mm, echoes.weight
    for k in range(echoes.count):
        dx_mm = xs[k] - x_mm
        if not -reach_mm < dx_mm < reach_mm:
            continue
        dy_mm = ys[k] - y_mm
        if not -reach_mm < dy_mm < reach_mm:
            continue
        away_mm = int(sqrt(dx_mm * dx_mm + dy_mm * dy_mm))
        if away_mm >= reach_mm:
            continue
        if away_mm < radius_mm:
            away_mm = push_out(echoes, k, x_mm, y_mm, away_mm, radius_mm)
        bearing = int(BRADS * atan2(dy_mm, dx_mm))
        if passed_through(ring, bearing - heading, away_mm - radius_mm):
            weight[k] -= 1
        body_mm = radius_mm - (DOUBT * echoes.spread_mm[k] >> 2) - ease_mm
        sure = weight[k] >= SURE
        if sure:
            add(sectors, k, bearing, away_mm, body_mm)
        along_mm = dx_mm * cosine + dy_mm * sine >> 10
        aside_mm = dy_mm * cosine - dx_mm * sine >> 10
        if along_mm > 0 and -body_mm < aside_mm < body_mm:
            free_mm = along_mm - int(sqrt(body_mm * body_mm - aside_mm * aside_mm))
            if not sure and free_mm < WARY_MM:
                free_mm = WARY_MM
            if free_mm < sectors.free_mm:
                sectors.free_mm = free_mm if free_mm > 0 else 0
    give_way(sectors, ring, heading, radius_mm)


def push_out(echoes: Echoes, k: int, x_mm: int, y_mm: int, away_mm: int, radius_mm: int) -> int:
    """Where the robot stands there is no obstacle: the echo came from beyond its rim."""
    if away_mm > 0:
        echoes.x_mm[k] = x_mm + (echoes.x_mm[k] - x_mm) * radius_mm // away_mm
        echoes.y_mm[k] = y_mm + (echoes.y_mm[k] - y_mm) * radius_mm // away_mm
    return radius_mm


def give_way(sectors: Sectors, ring: Ring, heading: int, radius_mm: int) -> None:
    """Who walks closes the headings that he will close in a moment."""
    for i in range(SONARS):
        range_m = ring.range_m[i]
        if ring.walks_m_s[i] > 0.0 and range_m is not None and range_m < REACH_M:
            away_mm = radius_mm + int(1000.0 * (range_m - WALK_S * ring.walks_m_s[i]))
            if away_mm < radius_mm:
                away_mm = radius_mm
            add(sectors, NOTHING, heading + int(BRADS * BEARINGS[i]), away_mm, radius_mm)


def add(sectors: Sectors, point: int, bearing: int, away_mm: int, body_mm: int) -> None:
    """One sector more, if it closes anything and there is room; else the farthest one goes."""
    wide = closed(away_mm, body_mm + WIDE_MM)
    if wide == 0:
        return
    n = sectors.count
    if n < NEAR:
        sectors.count += 1
    else:
        n = farthest(sectors)
        if sectors.away_mm[n] <= away_mm:
            return
    sectors.point[n] = point
    sectors.bearing[n] = bearing
    sectors.away_mm[n] = away_mm
    sectors.body_mm[n] = body_mm
    sectors.wide[n] = wide
    sectors.tight[n] = closed(away_mm, body_mm + TIGHT_MM)


def farthest(sectors: Sectors) -> int:
    n = 0
    for k in range(1, sectors.count):
        if sectors.away_mm[k] > sectors.away_mm[n]:
            n = k
    return n


def closed(away_mm: int, body_mm: int) -> int:
    """Half the sector of headings along which a disc of `body_mm` meets a point within the look."""
    if away_mm >= LOOK_MM + body_mm or body_mm <= 0:
        return 0
    if away_mm <= body_mm:
        return QUARTER
    square = away_mm * away_mm - body_mm * body_mm
    if square <= LOOK_MM * LOOK_MM:
        return ASIN[body_mm * TABLE // away_mm]
    share = (square + LOOK_MM * LOOK_MM) * (TABLE // 2) // (away_mm * LOOK_MM)
    return ACOS[share] if share < TABLE else 0


def squeeze(sectors: Sectors) -> None:
    """Work out the sectors without any margin."""
    for k in range(sectors.count):
        sectors.squeezed[k] = closed(sectors.away_mm[k], sectors.body_mm[k] + SQUEEZE_MM)


def closer(sectors: Sectors, heading: int, halves: "list[int]") -> int:
    """The nearest sector that closes this heading, or NOTHING; `halves`: `wide` or `tight`."""
    nearest = NOTHING
    for k in range(sectors.count):
        off = (sectors.bearing[k] - heading + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
        half = halves[k]
        if -half < off < half and (
            nearest == NOTHING or sectors.away_mm[k] < sectors.away_mm[nearest]
        ):
            nearest = k
    return nearest


def sweep(sectors: Sectors, start: int, side: int, halves: "list[int]") -> int:
    """How far to turn from `start` towards `side` until a heading is open; CIRCLE if none is.

    Sectors overlap, so a few passes over them, to and fro, find the end of a chain of them; one
    that is not at its end by then counts as endless.
    """
    offset, n = sectors.offset, sectors.count
    for k in range(n):
        offset[k] = (side * (sectors.bearing[k] - start) + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
    turn = 0
    sectors.closing = NOTHING
    for number in range(PASSES):
        moved = False
        for j in range(n):
            k = n - 1 - j if number & 1 else j
            off = turn - offset[k]
            if off > HALF_CIRCLE:
                off -= CIRCLE
            half = halves[k]
            if -half < off < half:
                turn += half - off
                sectors.closing = k
                moved = True
        if turn >= CIRCLE:
            return CIRCLE
        if not moved:
            return turn
    return CIRCLE


def room(sectors: Sectors, turn: int, halves: "list[int]") -> int:
    """How much farther headings stay open beyond the one that the last sweep ended with."""
    least = HALF_CIRCLE
    for k in range(sectors.count):
        if halves[k] > 0:
            ahead = (sectors.offset[k] - halves[k] - turn) % CIRCLE
            if ahead < least:
                least = ahead
    return least
