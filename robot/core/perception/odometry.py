"""Dead reckoning from wheel ticks, with its covariance (paper eq. 7-12).

The covariance has two terms that eq. 12 omits; without them the 95 % ellipse contains the true pose
too seldom. An uncertain heading not only moves the position sideways (first order) but also
shortens the way (second order: `bend`). And encoders count whole ticks (`grain`).
"""

from typing import Final

from robot.core.parameters import Params
from robot.core.values import Pose, Wheels, wrap
from runtime.elementary import cos_sin

COUNTER: Final = 0x100000000
HALF_COUNTER: Final = 0x80000000
SHORT: Final = 0x100000  # a smaller difference needs no wrapping
JUMP_SLACK_M: Final = 0.02
BEND: Final = 0.76
"""sqrt(7/12): combines mean and variance of 1 - cos of a random-walk heading."""
GRAIN_LENGTH_M: Final = 0.02
"""Distance over which the wheels' fractions of a tick, and their heading error, are correlated."""


class Odometry:
    """Pose, covariance in scalars (h: heading), speeds, and the last wheel motion.

    Before the first sample `left` and `right` are the totals at the start pose.
    `moved_m` is the mean distance the wheels rolled in the last update, in either direction.
    `jumped` is set if a counter moved farther than a wheel can turn; the pose ignores that step.
    `cosine` and `sine` belong to the heading halfway through the last step. `grain_m2` and
    `grain_rad2` are the variances caused by whole ticks, of a coordinate and of the heading: the
    latter does not grow and does not move the position.
    """

    __slots__ = (
        "at_ms",
        "bend_x_m",
        "bend_y_m",
        "cosine",
        "grain_m2",
        "grain_rad2",
        "jumped",
        "latched",
        "left",
        "left_m",
        "moved_m",
        "phh",
        "pose",
        "pxh",
        "pxx",
        "pxy",
        "pyh",
        "pyy",
        "right",
        "right_m",
        "sine",
        "speed_m_s",
        "yaw_rate_rad_s",
    )

    def __init__(self) -> None:
        self.pose = Pose(0.0, 0.0, 0.0)
        self.pxx = self.pxy = self.pxh = self.pyy = self.pyh = self.phh = 0.0
        self.bend_x_m = self.bend_y_m = 0.0
        self.grain_m2 = self.grain_rad2 = 0.0
        self.speed_m_s = self.yaw_rate_rad_s = 0.0
        self.left = self.right = self.at_ms = 0
        self.left_m = self.right_m = self.moved_m = self.sine = 0.0
        self.cosine = 1.0
        self.latched = self.jumped = False


def tick_difference(new: int, old: int) -> int:
    """Return the difference of two values of a 32-bit counter, by the shorter way."""
    difference = new - old
    if -SHORT < difference < SHORT:
        return difference
    difference %= COUNTER
    return difference - COUNTER if difference >= HALF_COUNTER else difference


def update(odometry: Odometry, wheels: Wheels | None, params: Params) -> None:
    """Update by one sample; the first only initialises the counters.

    None does not move the pose: the next difference includes the missing one. Speeds use the time
    between the two samples, however late they arrived; a repeated sample does not change them.
    """
    odometry.jumped = False
    if wheels is None:
        rest(odometry)
        return
    if not odometry.latched:
        start_grain(odometry, params)
    else:
        left_share, right_share = wheel_shares(params)
        m_per_tick, longest_s = params.m_per_tick, params.period_s
        left_m = tick_difference(wheels.left, odometry.left) * m_per_tick * left_share
        right_m = tick_difference(wheels.right, odometry.right) * m_per_tick * right_share
        elapsed_s = (wheels.at_ms - odometry.at_ms) * 1e-3
        if elapsed_s > longest_s:
            longest_s = elapsed_s
        reach_m = 2.0 * params.wheel_max_m_s * longest_s + JUMP_SLACK_M
        odometry.jumped = not (-reach_m <= left_m <= reach_m and -reach_m <= right_m <= reach_m)
        if odometry.jumped:
            rest(odometry)
        else:
            roll(odometry, left_m, right_m, params)
            if elapsed_s > 0.0:
                odometry.speed_m_s = 0.5 * (left_m + right_m) / elapsed_s
                odometry.yaw_rate_rad_s = (right_m - left_m) / (params.track_m * elapsed_s)
    odometry.left = wheels.left
    odometry.right = wheels.right
    odometry.at_ms = wheels.at_ms
    odometry.latched = True


def rest(odometry: Odometry) -> None:
    """Note that nothing is known to have moved since the last sample."""
    odometry.moved_m = odometry.left_m = odometry.right_m = 0.0


def roll(odometry: Odometry, left_m: float, right_m: float, params: Params) -> None:
    """Move pose and covariance by the wheels' distances (eq. 8 with the track L, not 2l).

    Eq. 8 takes the step for an arc. If speed v and turn w change linearly over this step and the
    last one, the robot also moves left by (v w' - v' w) / 12, where v' and w' are the last ones.
    """
    left_way_m, right_way_m, track_m = abs(left_m), abs(right_m), params.track_m
    aside_m = (left_m * odometry.right_m - right_m * odometry.left_m) / (12.0 * track_m)
    odometry.left_m = left_m
    odometry.right_m = right_m
    odometry.moved_m = 0.5 * (left_way_m + right_way_m)
    if left_m == 0.0 and right_m == 0.0:
        return
    x_m, y_m, heading_rad = odometry.pose
    step_m = 0.5 * (right_m + left_m)
    turn_rad = (right_m - left_m) / track_m
    middle_rad = heading_rad + 0.5 * turn_rad
    cosine, sine = cos_sin(middle_rad)
    odometry.cosine, odometry.sine = cosine, sine
    dx_m, dy_m = step_m * cosine - aside_m * sine, step_m * sine + aside_m * cosine
    odometry.pose = Pose(x_m + dx_m, y_m + dy_m, wrap(heading_rad + turn_rad))
    spread(odometry, dx_m, dy_m, params.k_r_m * right_way_m, params.k_l_m * left_way_m, track_m)


def wheel_shares(params: Params) -> tuple[float, float]:
    """Return the left and right wheel diameters over their mean (c_l, c_r of UMBmark)."""
    ratio = params.wheel_ratio
    if ratio == 1.0:
        return 1.0, 1.0
    return 2.0 / (ratio + 1.0), 2.0 / (1.0 / ratio + 1.0)


def start_grain(odometry: Odometry, params: Params) -> None:
    """Add the variance of whole ticks, which the first sample already has."""
    odometry.grain_m2 = variance_m2 = params.m_per_tick * params.m_per_tick / 6.0
    odometry.pxx += variance_m2
    odometry.pyy += variance_m2
    odometry.grain_rad2 = variance_m2 / (params.track_m * params.track_m)
    odometry.phh += odometry.grain_rad2


def spread(
    odometry: Odometry, dx_m: float, dy_m: float, right_m2: float, left_m2: float, track_m: float
) -> None:
    """P <- F_p P F_p' + F_q Q F_q' (eq. 10, 12): a heading error moves the position sideways.

    Before that, 1 - cos of the heading error shortens the way, on all steps in the same direction.
    The heading error of whole ticks adds a little, in random directions. Last come the variances of
    both wheels, each as by `blur`; in one function, which loads and stores P once.
    """
    half = 0.5 / track_m
    turn, way_x, way_y = 2.0 * half, dy_m * half, dx_m * half
    cosine, sine = 0.5 * odometry.cosine, 0.5 * odometry.sine
    right_x, right_y = cosine - way_x, sine + way_y
    left_x, left_y = cosine + way_x, sine - way_y
    rx, ry, rh = right_m2 * right_x, right_m2 * right_y, right_m2 * turn
    lx, ly, lh = left_m2 * left_x, left_m2 * left_y, left_m2 * -turn
    grain_rad2 = odometry.grain_rad2
    phh = odometry.phh - grain_rad2
    old_x_m, old_y_m, share = odometry.bend_x_m, odometry.bend_y_m, BEND * phh
    odometry.bend_x_m = x_m = old_x_m + share * dx_m
    odometry.bend_y_m = y_m = old_y_m + share * dy_m
    grain_m2 = grain_rad2 * GRAIN_LENGTH_M * odometry.moved_m
    pxh, pyh = odometry.pxh, odometry.pyh
    new_pxh, new_pyh = pxh - dy_m * phh, pyh + dx_m * phh
    bent_m2 = x_m * x_m - old_x_m * old_x_m + grain_m2
    pxx = odometry.pxx + bent_m2 - dy_m * (pxh + new_pxh)
    bent_m2 = x_m * y_m - old_x_m * old_y_m
    pxy = odometry.pxy + bent_m2 + (dx_m * new_pxh - dy_m * pyh)
    bent_m2 = y_m * y_m - old_y_m * old_y_m + grain_m2
    pyy = odometry.pyy + bent_m2 + dx_m * (pyh + new_pyh)
    odometry.pxx = pxx + rx * right_x + lx * left_x
    odometry.pxy = pxy + rx * right_y + lx * left_y
    odometry.pxh = new_pxh + rx * turn + lx * -turn
    odometry.pyy = pyy + ry * right_y + ly * left_y
    odometry.pyh = new_pyh + ry * turn + ly * -turn
    odometry.phh = odometry.phh + rh * turn + lh * -turn


def blur(odometry: Odometry, variance_m2: float, x: float, y: float, h: float) -> None:
    """P <- P + q f f': add a wheel's variance (eq. 10) by its column (x, y, h) of F_q."""
    qx, qy, qh = variance_m2 * x, variance_m2 * y, variance_m2 * h
    odometry.pxx += qx * x
    odometry.pxy += qx * y
    odometry.pxh += qx * h
    odometry.pyy += qy * y
    odometry.pyh += qy * h
    odometry.phh += qh * h
