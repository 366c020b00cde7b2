"""The direction of a straight wall beside the robot, from its range along a way.

The cone of the last sonar of a flank contains the normal of a wall along which the robot drives.
So its range is the distance of the wall, and the position of the robot adds what the robot came
nearer. Along a straight wall this sum changes in proportion to the way. Its line of best fit gives
the direction of the wall in the frame of the odometry.

A stretch has two blocks. It counts only if one line fits both as well as a line for each does:
arcs, corners and ends of walls do not. Integers: millimetres of way, tenths of a millimetre of
distance.
"""

from typing import Final

from robot.core.geometry import wrap
from robot.core.perception.odometry import Odometry

BLOCK_MM: Final = 170
MIN_ECHOES: Final = 8
"""Echoes in a block."""
MAX_ECHOES: Final = 80
FAR_M: Final = 0.6
CLAMPED_M: Final = 0.03  # nearer than a sonar can measure
AWAY_RAD: Final = 0.2  # turned farther away, the normal of the wall is outside of the cone
TOWARDS_RAD: Final = 0.33
GATE: Final = 250  # tenths of a millimetre between two echoes of the same wall
GATE_PER_M: Final = 400
STRIKES: Final = 3  # echoes in a row that do not fit: another obstacle is beside the robot
STEEPEST: Final = 0.25
ALONG: Final = 0.08
MIN_SCATTER: Final = 900.0  # variance of a distance in tenths of a millimetre squared
MAX_SCATTER: Final = 60000.0
BENT: Final = 12.0  # chi-square of two lines against one, with two degrees of freedom


class Stretch:
    """Echoes at one flank since the pose where the stretch began.

    `side` is 1 left, -1 right. `heading_rad` is the direction of the way, `growth_rad2` the
    increase of the variance of the heading on it. `older` and `newer` are the sums of both blocks:
    count, way, way squared, distance, way times distance, distance squared. Distances are relative
    to `first`. `repeats` is the number of stretches before along the same wall.
    """

    __slots__ = (
        "begin_mm",
        "cosine",
        "first",
        "growth_rad2",
        "heading_rad",
        "last",
        "newer",
        "older",
        "repeats",
        "side",
        "sine",
        "strikes",
        "x_m",
        "y_m",
    )

    def __init__(self, side: int) -> None:
        self.side = side
        self.heading_rad = self.cosine = self.sine = self.x_m = self.y_m = self.growth_rad2 = 0.0
        self.begin_mm = self.first = self.last = self.repeats = 0
        self.strikes = STRIKES
        self.newer = [0, 0, 0, 0, 0, 0]
        self.older = [0, 0, 0, 0, 0, 0]


def begin(
    stretch: Stretch, odometry: Odometry, heading_rad: float, cosine: float, sine: float
) -> None:
    """Begin a stretch along a direction at the present pose."""
    stretch.heading_rad, stretch.cosine, stretch.sine = heading_rad, cosine, sine
    stretch.x_m, stretch.y_m, _ = odometry.pose
    stretch.growth_rad2 = 0.0
    stretch.begin_mm = stretch.strikes = 0
    clear(stretch.newer)
    clear(stretch.older)


def clear(sums: list[int]) -> None:
    """Set all sums to zero."""
    for i in (0, 1, 2, 3, 4, 5):
        sums[i] = 0


def add(stretch: Stretch, odometry: Odometry, range_m: float, radius_m: float) -> bool:
    """Add an echo; return whether both blocks are complete."""
    x_m, y_m, heading_rad = odometry.pose
    side, cosine, sine = stretch.side, stretch.cosine, stretch.sine
    towards_rad = wrap(heading_rad - stretch.heading_rad)
    if side < 0:
        towards_rad = -towards_rad
    if not -AWAY_RAD < towards_rad < TOWARDS_RAD:
        stretch.strikes += 1
        return False
    distance_m = range_m + radius_m
    if towards_rad < 0.0:  # the edge of the cone meets the wall farther ahead
        distance_m *= 1.0 - 0.5 * towards_rad * towards_rad
    dx_m, dy_m = x_m - stretch.x_m, y_m - stretch.y_m
    way_mm = int(1000.0 * (cosine * dx_m + sine * dy_m))
    distance = int(1e4 * (distance_m + side * (cosine * dy_m - sine * dx_m))) - stretch.first
    newer = stretch.newer
    count = newer[0]
    if count == 0 and stretch.older[0] == 0:
        stretch.first += distance
        stretch.last = distance = 0
    gate = GATE + int(GATE_PER_M * distance_m)
    if not -gate < distance - stretch.last < gate:
        stretch.strikes += 1
        return False
    stretch.strikes, stretch.last = 0, distance
    if count < MAX_ECHOES:
        accumulate(newer, way_mm, distance)
    if -BLOCK_MM < way_mm - stretch.begin_mm < BLOCK_MM:
        return False
    if stretch.older[0]:
        return True
    stretch.older, stretch.newer = newer, stretch.older
    stretch.begin_mm = way_mm
    return False


def accumulate(sums: list[int], way_mm: int, distance: int) -> None:
    """Add one echo to the sums of a block."""
    sums[0] += 1
    sums[1] += way_mm
    sums[2] += way_mm * way_mm
    sums[3] += distance
    sums[4] += way_mm * distance
    sums[5] += distance * distance


def fit(sums: list[int]) -> tuple[float, float, float]:
    """Return slope, remaining sum of squares and spread of the way of a line of best fit.

    In tenths of a millimetre per millimetre, their squares, and square millimetres.
    """
    count, way = float(sums[0]), float(sums[1])
    middle = way / count
    spread = sums[2] - way * middle
    if spread <= 0.0:
        return 0.0, 0.0, 0.0
    share = sums[4] - sums[3] * middle
    slope = share / spread
    rest = sums[5] - sums[3] * (sums[3] / count) - slope * share
    return slope, (rest if rest > 0.0 else 0.0), spread


def direction(stretch: Stretch, odometry: Odometry) -> tuple[float, float] | None:
    """Return the angle of the wall from the way and its variance, None if it is not straight."""
    older, newer = stretch.older, stretch.newer
    if older[0] < MIN_ECHOES or newer[0] < MIN_ECHOES:
        return None
    _, older_rest, _ = fit(older)
    _, newer_rest, _ = fit(newer)
    for i in (0, 1, 2, 3, 4, 5):
        older[i] += newer[i]
    slope, rest, spread = fit(older)
    scatter = (older_rest + newer_rest) / (older[0] - 4)
    if scatter < MIN_SCATTER:
        scatter = MIN_SCATTER
    slope *= 0.1
    dx_m, dy_m = odometry.pose.x_m - stretch.x_m, odometry.pose.y_m - stretch.y_m
    way_m = stretch.cosine * dx_m + stretch.sine * dy_m
    aside_m = stretch.side * (stretch.cosine * dy_m - stretch.sine * dx_m)
    nearer_m = slope * way_m - aside_m
    if not abs(nearer_m) <= ALONG * abs(way_m):
        return None
    bent = rest - older_rest - newer_rest > BENT * scatter
    if bent or scatter > MAX_SCATTER or not -STEEPEST < slope < STEEPEST or spread <= 0.0:
        return None
    angle_rad = slope * (1.0 + slope * slope / 6.0)
    return (angle_rad if stretch.side > 0 else -angle_rad), 0.01 * scatter / spread
