"""Prove by turning on the spot that there is no way out of a place.

In a cell that is hardly larger than the robot a lap along the boundary is too short for a chain of
echoes (`proof`). But there each cone sees a surface close by, whatever its direction. An echo shows
that a surface touches the arc of its cone at that distance, but not where. If every point of one
arc is nearer to every point of the next one than the robot is wide, the robot does not fit between
the two surfaces. If that holds all the way round, the surfaces shut the robot in.

Bearings are brads: integers, 4096 to the circle.
"""

from math import sqrt
from typing import Final

from robot.core.navigators.proof import Chain, chain_width_mm
from robot.core.perception.echoes import BRADS, CIRCLE, HALF_CIRCLE, NOTHING
from robot.core.ring import CONE, SONARS
from robot.core.values import EVERY, Pose, whole_cos_sin
from runtime.elementary import coarse_atan2, cos

BINS: Final = 128
BIN: Final = CIRCLE // BINS
ROUNDS: Final = 2  # so that nobody who passes by is taken for a wall
MOVED_MM: Final = 30  # farther from where the turn began, it begins again
MAX_EMPTY: Final = 2  # bins in a row without an echo
MAX_DRIVE: Final = 60  # choices on the way to the middle
UNIT_MM: Final = 4  # of the stored distances; they are rounded up
MAX_AWAY: Final = 130  # in UNIT_MM, where there was no echo
FIRST: Final = int(BRADS * -0.5 * (SONARS - 1) * CONE)
NEXT: Final = int(BRADS * CONE)
COSINES: Final = tuple(
    [int(1024 * cos(CONE + (gap + 1) * BIN / BRADS)) for gap in range(MAX_EMPTY + 2)]
)
"""Cosines, scaled to 1024, of the largest angle between points of two cones so many bins apart."""


class LookAround:
    """A turn on the spot: the distance of the last echo in each direction, in UNIT_MM.

    `x_mm` and `y_mm` are where it began, `heading` is the last one, `turned` the turn since then.
    `rounds` counts the whole turns that were closed by echoes all the way round. `drive` is the
    number of choices for which the robot still drives at `bearing`, to the middle of the place, and
    `is_middle` is set once it has.
    """

    __slots__ = (
        "away",
        "bearing",
        "drive",
        "heading",
        "is_active",
        "is_middle",
        "rounds",
        "turned",
        "way_mm",
        "x_mm",
        "y_mm",
    )

    def __init__(self) -> None:
        self.away = bytearray(BINS)
        self.is_active = self.is_middle = False
        self.bearing = self.drive = self.way_mm = 0
        self.x_mm = self.y_mm = self.heading = self.turned = self.rounds = 0


def begin(look: LookAround, pose: Pose) -> None:
    """Begin here."""
    look.is_active = True
    look.rounds = look.drive = 0
    look.x_mm, look.y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    look.heading = int(BRADS * pose.heading_rad)
    new_round(look)


def new_round(look: LookAround) -> None:
    """Forget the echoes of the last round."""
    look.turned = 0
    for k in range(BINS):
        look.away[k] = 0


def watch(look: LookAround, chain: Chain, pose: Pose, radius_mm: int) -> None:
    """Store the echoes of a scan by direction; begin again where the robot has moved."""
    if look.drive > 0:
        return
    dx_mm, dy_mm = int(1000.0 * pose.x_m) - look.x_mm, int(1000.0 * pose.y_m) - look.y_mm
    if not (-MOVED_MM < dx_mm < MOVED_MM and -MOVED_MM < dy_mm < MOVED_MM):
        begin(look, pose)
        return
    heading = int(BRADS * pose.heading_rad)
    step = (heading - look.heading + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
    halfway = heading - step // 2
    look.heading = heading
    look.turned += step
    for i in EVERY:
        if chain.seen >> i & 1:
            bearing = (heading if i & 1 else halfway) + FIRST + i * NEXT
            away = (chain.range_mm[i + 1] + radius_mm + UNIT_MM - 1) // UNIT_MM
            look.away[bearing // BIN % BINS] = away


def is_round(look: LookAround) -> bool:
    """Return whether the robot has turned once round."""
    return not -CIRCLE < look.turned < CIRCLE


def is_shut(look: LookAround, radius_mm: int) -> bool:
    """Return whether the robot fits between no two of the surfaces around it."""
    width_mm = chain_width_mm(radius_mm)
    width2 = width_mm * width_mm // (UNIT_MM * UNIT_MM)
    away = look.away
    last = NOTHING
    for k in range(2 * BINS):
        here = away[k % BINS]
        if here == 0:
            continue
        if last != NOTHING:
            gap = k - last
            if gap > MAX_EMPTY + 1:
                return False
            there = away[last % BINS]
            if here * here + there * there - (here * there * COSINES[gap] >> 9) >= width2:
                return False
        last = k
    return last != NOTHING


def to_middle(look: LookAround) -> bool:
    """Begin to drive to the middle of the place, once; return False if that has been tried.

    A round place with the robot `e` beside its middle has its surfaces at R + e cos(bearing).
    """
    if look.is_middle:
        return False
    x = y = 0
    for k in range(BINS):
        cosine, sine = whole_cos_sin((k + 0.5) * BIN / BRADS)
        away = look.away[k] or MAX_AWAY
        x += away * cosine
        y += away * sine
    look.is_middle = True
    look.bearing = int(BRADS * coarse_atan2(y, x))
    look.drive = MAX_DRIVE
    look.way_mm = 2 * UNIT_MM * int(sqrt(x * x + y * y)) // (BINS << 10)
    return True


def is_there(look: LookAround, pose: Pose) -> bool:
    """Return whether the robot has driven to the middle, or has tried for long enough."""
    dx_mm, dy_mm = int(1000.0 * pose.x_m) - look.x_mm, int(1000.0 * pose.y_m) - look.y_mm
    look.drive -= 1
    return look.drive == 0 or dx_mm * dx_mm + dy_mm * dy_mm >= look.way_mm * look.way_mm
