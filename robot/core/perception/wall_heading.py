"""Correct the heading by the directions of walls beside the robot.

The cone of the last sonar of a flank contains the normal of a wall along which the robot drives. So
its range is the distance of the wall, and the position of the robot adds what the robot came
nearer. Along a straight wall this sum changes in proportion to the way. Its line of best fit gives
the direction of the wall in the frame of the odometry. A stretch has two blocks. It counts only if
one line fits both as well as a line for each does: arcs, corners and ends of walls do not.
Integers: millimetres of way, tenths of a millimetre of distance.

In most buildings the walls are parallel or at right angles. The first wall beside the robot gives a
reference direction, modulo 90 degrees, which is estimated with its own variance and its covariance
with the pose. Every later wall of the same direction corrects heading, position and reference in
one Kalman step with four states.

Walls may also have any direction. So each step is weighted with the probability that the wall
belongs to the reference (probabilistic data association): the share of walls that did so far,
against a uniform distribution. There is no step while most walls differ, and another direction
becomes the reference if more walls in a row have it. The differences between walls that should be
parallel give the variance of a wall's direction.
"""

from math import pi, sqrt
from typing import Final

from robot.core.parameters import Params
from robot.core.perception.odometry import Odometry
from robot.core.perception.slip import Slip
from robot.core.perception.sonar_ring import CLAMPED_M, Ring
from robot.core.values import Pose, wrap
from runtime.elementary import cos_sin, exp

BLOCK_MM: Final = 170
MIN_ECHOES: Final = 8
"""Echoes in a block."""
MAX_ECHOES: Final = 80
FAR_M: Final = 0.6
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


def begin_stretch(
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


QUARTER_RAD: Final = 0.5 * pi
SNAP_RAD: Final = 0.3  # the way is measured along the reference if it is that near
SURE_RAD2: Final = 1e-5  # variance of a heading that needs no correction
LOST_RAD2: Final = 0.1  # of a difference that does not distinguish walls at right angles
MEAN: Final = 0.629
LATE: Final = 0.5
ASIDE: Final = 0.15
"""A stretch gives its mean heading error, weighted with 6 s (1 - s), not the last one. A random
walk of variance g on it makes their covariance smaller by LATE g, its variance by MEAN g, and the
covariance with the position by ASIDE g times the way."""
BELIEF: Final = 0.8  # minimum probability that a wall belongs to the reference
WALL_RAD2: Final = 5e-5  # variance of the direction of one wall, 0.4 degrees squared
NEARLY_RAD: Final = 0.17  # walls that differ by less show how parallel walls are
KNOWN: Final = 3.0  # number of walls that this value counts as
RECENT: Final = 30.0
OUTLIER: Final = 25.0
SAME: Final = 4.0  # squared sigmas between two walls of the same direction
ROOT_TWO_PI: Final = 2.5066282746310002


class WallHeading:
    """The stretches at both flanks, and the reference direction `wall_rad`.

    `p*w` are its covariances with x, y and heading, and its variance. `agreed` and `differed` count
    the walls after the first; `agreed` is negative without a reference. `support` counts the last
    walls that differ from the reference and agree with each other; the last of them is `other_rad`,
    at the heading's variance `other_phh`. `spread_rad2` is the variance of a wall's direction.
    `angle_rad` and `variance_rad2` are the direction of the stretch `complete`, 0 before it is
    measured.
    """

    __slots__ = (
        "agreed",
        "angle_rad",
        "complete",
        "differed",
        "left",
        "other_phh",
        "other_rad",
        "phw",
        "pww",
        "pxw",
        "pyw",
        "right",
        "spread_rad2",
        "support",
        "variance_rad2",
        "wall_rad",
    )

    def __init__(self) -> None:
        self.right, self.left = Stretch(-1), Stretch(1)
        self.wall_rad = self.pxw = self.pyw = self.phw = self.pww = self.differed = 0.0
        self.other_rad = self.other_phh = self.support = 0.0
        self.complete: Stretch | None = None
        self.angle_rad = self.variance_rad2 = 0.0
        self.agreed = -1.0
        self.spread_rad2 = WALL_RAD2


def watch(walls: WallHeading, odometry: Odometry, ring: Ring, slip: Slip, params: Params) -> None:
    """Process the last step of the wheels and the scan after it."""
    if odometry.moved_m == 0.0:
        return
    x_m, y_m, heading_rad = odometry.pose
    finite = x_m + y_m + heading_rad
    if finite - finite != 0.0:
        return
    left_m, right_m, track_m = odometry.left_m, odometry.right_m, params.track_m
    if walls.agreed >= 0.0:
        step_m = 0.5 * (left_m + right_m)
        walls.pxw -= step_m * odometry.sine * walls.phw
        walls.pyw += step_m * odometry.cosine * walls.phw
    growth_rad2 = params.k_l_m * abs(left_m) + params.k_r_m * abs(right_m)
    growth_rad2 /= track_m * track_m
    right, left, radius_m = walls.right, walls.left, params.radius_m
    right.growth_rad2 += growth_rad2
    left.growth_rad2 += growth_rad2
    stretch = walls.complete
    if stretch is not None:
        proceed(walls, stretch, odometry, slip)
        return
    range_m = ring.range_m
    if see(walls, right, range_m[0], odometry, radius_m):
        walls.complete = right
    if see(walls, left, range_m[7], odometry, radius_m):
        walls.complete = left


def see(
    walls: WallHeading, stretch: Stretch, range_m: float | None, odometry: Odometry, radius_m: float
) -> bool:
    """Take the echo at one flank; return whether the stretch is complete."""
    if range_m is None or not CLAMPED_M < range_m < FAR_M:
        stretch.strikes += 1
        return False
    if stretch.strikes >= STRIKES:
        begin(walls, stretch, odometry, 0)
    return add(stretch, odometry, range_m, radius_m)


def proceed(walls: WallHeading, stretch: Stretch, odometry: Odometry, slip: Slip) -> None:
    """Measure a complete stretch; one tick later use it and begin new ones at both flanks.

    Both in one tick would take too long on the MCU. A correction changes the pose, so that echoes
    before and after it do not fit together. Nothing is corrected while the wheels slip.
    """
    repeats = 0
    if walls.variance_rad2 == 0.0:
        found = direction(stretch, odometry)
        if found is not None and slip.share == 0.0:
            walls.angle_rad, walls.variance_rad2 = found
            return
    else:
        compare(walls, stretch, odometry, slip)
        repeats = stretch.repeats + 1
    walls.complete, walls.variance_rad2 = None, 0.0
    for other in (walls.right, walls.left):
        if other.strikes < STRIKES:
            begin(walls, other, odometry, repeats if other is stretch else other.repeats)


def begin(walls: WallHeading, stretch: Stretch, odometry: Odometry, repeats: int) -> None:
    """Begin a stretch along the heading, or along the reference near it."""
    heading_rad = odometry.pose.heading_rad
    if walls.agreed >= 0.0:
        off_rad = within_quarter(walls.wall_rad - heading_rad)
        if -SNAP_RAD < off_rad < SNAP_RAD:
            heading_rad += off_rad
    cosine, sine = cos_sin(heading_rad)
    begin_stretch(stretch, odometry, heading_rad, cosine, sine)
    stretch.repeats = repeats


def within_quarter(angle_rad: float) -> float:
    """Return the same direction modulo 90 degrees, within 45 degrees."""
    angle_rad %= QUARTER_RAD
    return angle_rad - QUARTER_RAD if angle_rad > 0.5 * QUARTER_RAD else angle_rad


def compare(walls: WallHeading, stretch: Stretch, odometry: Odometry, slip: Slip) -> None:
    """Compare the direction of a wall with the reference, and correct or replace that."""
    wall_rad, variance_rad2 = stretch.heading_rad + walls.angle_rad, walls.variance_rad2
    growth_rad2, repeats = stretch.growth_rad2, stretch.repeats
    x_m, y_m, _ = odometry.pose
    cx = odometry.pxh + ASIDE * growth_rad2 * (y_m - stretch.y_m)
    cy = odometry.pyh - ASIDE * growth_rad2 * (x_m - stretch.x_m)
    ch = odometry.phh - LATE * growth_rad2
    mean_rad2 = odometry.phh - MEAN * growth_rad2
    variance_rad2 += walls.spread_rad2 * (1 + repeats) + (mean_rad2 if mean_rad2 > 0.0 else 0.0)
    belief = 0.0
    if walls.agreed >= 0.0:
        total_rad2 = variance_rad2 - 2.0 * walls.phw + walls.pww
        off_rad = within_quarter(walls.wall_rad - wall_rad)
        if 0.0 < total_rad2 < LOST_RAD2:
            belief = probability(walls, off_rad * off_rad / total_rad2, total_rad2)
        if repeats == 0 and -NEARLY_RAD < off_rad < NEARLY_RAD:
            learn(walls, off_rad * off_rad - total_rad2 + walls.spread_rad2)
        if belief > BELIEF:
            if repeats == 0:
                walls.agreed += 1.0
            if walls.differed <= walls.agreed + 1.0:
                correct(walls, odometry, slip, cx, cy, ch, off_rad, total_rad2, belief)
            return
        differs = total_rad2 < LOST_RAD2
        if differs and (repeats > 0 or not replaces(walls, wall_rad, odometry.phh)):
            return
    else:
        walls.agreed = 0.0
    walls.wall_rad, walls.pww = wall_rad, variance_rad2
    walls.pxw, walls.pyw, walls.phw = cx, cy, ch


def replaces(walls: WallHeading, wall_rad: float, phh: float) -> bool:
    """Count a wall that differs; return whether more walls support it than the reference.

    The walls that supported the reference are then the ones that differ.
    """
    walls.differed += 1.0
    off_rad = within_quarter(walls.other_rad - wall_rad)
    other_rad2 = 4.0 * walls.spread_rad2 + abs(phh - walls.other_phh)
    if walls.support > 0.0 and off_rad * off_rad < SAME * other_rad2:
        walls.support += 1.0
    else:
        walls.support = 1.0
    walls.other_rad, walls.other_phh = wall_rad, phh
    if walls.support <= walls.agreed + 1.0:
        return False
    walls.differed, walls.agreed = walls.agreed + 1.0, walls.support - 1.0
    walls.support = 0.0
    return True


def probability(walls: WallHeading, distance2: float, variance_rad2: float) -> float:
    """Return the probability that a wall belongs to the reference."""
    share = (walls.agreed + 1.0) / (walls.agreed + walls.differed + 2.0)
    parallel = share * exp(-0.5 * distance2) / (ROOT_TWO_PI * sqrt(variance_rad2))
    return parallel / (parallel + (1.0 - share) / QUARTER_RAD)


def learn(walls: WallHeading, excess_rad2: float) -> None:
    """Adapt the variance of a wall's direction to the difference of another wall."""
    spread_rad2 = walls.spread_rad2
    if excess_rad2 > OUTLIER * spread_rad2:
        excess_rad2 = OUTLIER * spread_rad2
    count = walls.agreed + KNOWN
    spread_rad2 += (excess_rad2 - spread_rad2) / (count if count < RECENT else RECENT)
    walls.spread_rad2 = spread_rad2 if spread_rad2 > WALL_RAD2 else WALL_RAD2


def correct(
    walls: WallHeading,
    odometry: Odometry,
    slip: Slip,
    cx: float,
    cy: float,
    ch: float,
    off_rad: float,
    variance_rad2: float,
    belief: float,
) -> None:
    """Correct pose and reference by a difference; cx, cy, ch: its covariances with the pose."""
    if odometry.phh < SURE_RAD2:
        return
    cx, cy, ch, cw = cx - walls.pxw, cy - walls.pyw, ch - walls.phw, walls.phw - walls.pww
    gain = belief / variance_rad2
    x_m, y_m, heading_rad = odometry.pose
    step = gain * off_rad
    odometry.pose = Pose(x_m + step * cx, y_m + step * cy, wrap(heading_rad + step * ch))
    walls.wall_rad += step * cw
    lean = gain * slip.both_h
    slip.both_x, slip.both_y = slip.both_x - lean * cx, slip.both_y - lean * cy
    slip.both_h -= lean * ch
    lean = gain * slip.one_h
    slip.one_x, slip.one_y = slip.one_x - lean * cx, slip.one_y - lean * cy
    slip.one_h -= lean * ch
    # A wrong association would have moved the pose for nothing.
    gain -= belief * (1.0 - belief) * off_rad * off_rad / (variance_rad2 * variance_rad2)
    gx, gy, gh = gain * cx, gain * cy, gain * ch
    odometry.pxx -= gx * cx
    odometry.pxy -= gx * cy
    odometry.pxh -= gx * ch
    odometry.pyy -= gy * cy
    odometry.pyh -= gy * ch
    odometry.phh -= gh * ch
    walls.pxw -= gx * cw
    walls.pyw -= gy * cw
    walls.phw -= gh * cw
    walls.pww -= gain * cw * cw
