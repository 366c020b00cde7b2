"""Detect wheel slip with the sonars ahead.

A robot that slips drives less far than its encoders show, and an echo ahead comes nearer by less.
The foremost echo ahead, if nearer than the echoes of the neighbouring cones, is a point or a
surface. If static, its range must shrink by at least cos 22.5 deg of the distance driven. If it
shrinks by less over `WINDOW_M`, the wheels slip. A pedestrian that walks away looks the same; the
uncertainty of the pose is then larger than necessary.

The slip may have begun after the last stretch without slip, at most about `MEMORY_M` ago. Until the
next such stretch the wheels may lose the missing share of their distance. Without an echo ahead the
slip is unknown.
"""

from math import inf, sqrt
from typing import Final

from robot.core.parameters import Params
from robot.core.perception.odometry import Odometry, blur
from robot.core.perception.sonar_ring import AHEAD, Ring

WINDOW_M: Final = 0.35
MEMORY_M: Final = 1.0
LASTS_M: Final = 1.5  # slip ends after this distance without evidence
FAR_M: Final = 2.5
FOREMOST: Final = 0.99
CLOSING: Final = 0.96
UNSURE: Final = 0.04  # maximum difference of cosines up to 22.5 degrees from CLOSING
SETTLE: Final = 6  # scans in the first level of a stretch
NEW: Final = 0.25  # weight of a new scan in the level
LATE: Final = 5.5  # scans between the middles of the first and the last level
MIN_SCANS: Final = 16
STRIKES: Final = 3  # scans in a row that do not fit: another obstacle is ahead
GATE_M: Final = 0.08
SIGMAS: Final = 2.5  # of a single scan; the difference of the two levels has half of that
MIN_SHARE: Final = 0.15
SPLIT: Final = 0.06  # a larger difference would turn the robot away


class Slip:
    """`share` is the share of the distance that seems lost, 0 without known slip.

    `both_*`, `one_*`: the error of the pose per share lost by both wheels, or by one more than by
    the other, since the last stretch without slip. `level_m` is constant while the range shrinks as
    expected; `anchor_m` is its initial value.
    """

    __slots__ = (
        "anchor_m",
        "both_h",
        "both_x",
        "both_y",
        "last_m",
        "level_m",
        "one_h",
        "one_x",
        "one_y",
        "scatter_m2",
        "seen",
        "share",
        "strikes",
        "unseen_m",
        "way_m",
    )

    def __init__(self) -> None:
        self.both_x = self.both_y = self.both_h = 0.0
        self.one_x = self.one_y = self.one_h = 0.0
        self.share = self.unseen_m = self.way_m = self.scatter_m2 = 0.0
        self.anchor_m = self.level_m = self.last_m = 0.0
        self.seen = self.strikes = 0


def watch(slip: Slip, odometry: Odometry, ring: Ring, params: Params) -> None:
    """Process the last step of the wheels and the scan after it."""
    if odometry.moved_m == 0.0:
        return
    carry(slip, odometry, params)
    slip.way_m += 0.5 * (odometry.left_m + odometry.right_m)
    follow(slip, foremost_m(ring, params))
    if slip.seen >= MIN_SCANS and slip.way_m >= WINDOW_M:
        judge(slip, odometry)
        slip.seen = 0


def carry(slip: Slip, odometry: Odometry, params: Params) -> None:
    """Propagate the error per lost share by the last step; extend the covariance while slipping."""
    left_m, right_m, track_m = odometry.left_m, odometry.right_m, params.track_m
    cosine, sine = odometry.cosine, odometry.sine
    step_m = 0.5 * (left_m + right_m)
    turn_rad = (right_m - left_m) / track_m
    dx_m, dy_m = step_m * cosine, step_m * sine
    slip.both_x -= dy_m * slip.both_h
    slip.both_y += dx_m * slip.both_h
    slip.one_x -= dy_m * slip.one_h
    slip.one_y += dx_m * slip.one_h
    kept = 1.0
    if slip.share > 0.0:
        widen(slip, odometry, -slip.share)
    else:
        kept = 1.0 - odometry.moved_m / MEMORY_M
        if kept < 0.0:
            kept = 0.0
    half_turn_rad = 0.5 * turn_rad
    slip.both_x = slip.both_x * kept + (dx_m - dy_m * half_turn_rad)
    slip.both_y = slip.both_y * kept + (dy_m + dx_m * half_turn_rad)
    slip.both_h = slip.both_h * kept + turn_rad
    half = 0.5 * step_m / track_m
    quarter_m = 0.5 * half_turn_rad * track_m
    slip.one_x = slip.one_x * kept + (quarter_m * cosine - dy_m * half)
    slip.one_y = slip.one_y * kept + (quarter_m * sine + dx_m * half)
    slip.one_h = slip.one_h * kept + 2.0 * half
    if slip.share > 0.0:
        widen(slip, odometry, slip.share)
        slip.unseen_m += odometry.moved_m
        if slip.unseen_m > LASTS_M:
            trust(slip)


def widen(slip: Slip, odometry: Odometry, share: float) -> None:
    """P <- P +- share^2 f f' for both kinds of slip; a negative share subtracts."""
    variance = share * abs(share)
    split = min(abs(share), SPLIT)
    blur(odometry, variance, slip.both_x, slip.both_y, slip.both_h)
    variance = split * split if share > 0.0 else -split * split
    blur(odometry, variance, slip.one_x, slip.one_y, slip.one_h)


def foremost_m(ring: Ring, params: Params) -> float:
    """Return the distance from the robot's centre to the foremost echo ahead, or inf.

    It is inf if the cones beside measure nearer echoes.
    """
    ahead_m = aside_m = inf
    for i in AHEAD:
        here_m = ring.range_m[i]
        if here_m is not None and here_m < ahead_m:
            ahead_m = here_m
    for i in (2, 5):
        here_m = ring.range_m[i]
        if here_m is None:
            return inf
        if here_m < aside_m:
            aside_m = here_m
    ahead_m += params.radius_m
    if ahead_m > FAR_M or ahead_m > FOREMOST * (aside_m + params.radius_m):
        return inf
    return ahead_m


def follow(slip: Slip, ahead_m: float) -> None:
    """Add one scan to the level; restart the stretch after several that do not fit."""
    level_m = ahead_m + CLOSING * slip.way_m
    off_m = level_m - slip.level_m
    if slip.seen == 0:
        if ahead_m < inf:
            slip.way_m = slip.scatter_m2 = 0.0
            slip.anchor_m = slip.level_m = slip.last_m = ahead_m
            slip.seen, slip.strikes = 1, 0
        return
    if not abs(off_m) <= GATE_M + SIGMAS * sqrt(slip.scatter_m2):
        slip.strikes += 1
        if slip.strikes >= STRIKES:
            slip.seen = 0
        return
    slip.strikes = 0
    slip.seen += 1
    change_m = level_m - slip.last_m
    slip.last_m = level_m
    slip.level_m += (NEW if slip.seen > SETTLE else 1.0 / slip.seen) * off_m
    weight = 1.0 / slip.seen if slip.seen < 10 else 0.1
    slip.scatter_m2 += weight * (0.5 * change_m * change_m - slip.scatter_m2)
    if slip.seen <= SETTLE:
        slip.anchor_m = slip.level_m


def judge(slip: Slip, odometry: Odometry) -> None:
    """Evaluate a stretch: slip starts or continues, or there is none."""
    lost_m = slip.level_m - slip.anchor_m
    way_m = slip.way_m * (1.0 - LATE / slip.seen)
    chance_m = UNSURE * way_m + SIGMAS * sqrt(slip.scatter_m2)
    share = min(lost_m / way_m, 1.0)
    if lost_m > chance_m and share > MIN_SHARE:
        if slip.share > 0.0:
            widen(slip, odometry, -slip.share)
        slip.share, slip.unseen_m = max(slip.share, share), 0.0
        widen(slip, odometry, slip.share)
    elif lost_m > -chance_m:
        trust(slip)


def trust(slip: Slip) -> None:
    """End the slip; the covariance keeps its extension."""
    slip.share = slip.unseen_m = 0.0
    slip.both_x = slip.both_y = slip.both_h = 0.0
    slip.one_x = slip.one_y = slip.one_h = 0.0
