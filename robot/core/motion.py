"""How the robot moves: twists towards a point or pose, the trail for the way back, and progress."""

from math import inf, pi, sqrt
from typing import Final

from robot.core import reasons
from robot.core.parameters import Params
from robot.core.perception.odometry import wheel_shares
from robot.core.values import Pose, Twist, wrap
from runtime.elementary import cos_sin, tanh

SPACING_M: Final = 0.25
LIMIT: Final = 128
PASSED_M: Final = 0.20


class Trail:
    """Points from the start, the newest last; the spacing doubles each time they are thinned.

    The first `count` items of the lists are used. The lists never grow: on a microcontroller the
    free memory may lack a block for a longer one.
    """

    __slots__ = ("count", "spacing_m", "xs_m", "ys_m")

    def __init__(self) -> None:
        self.count = 0
        self.xs_m = [0.0] * LIMIT
        self.ys_m = [0.0] * LIMIT
        self.spacing_m = SPACING_M


def drop_crumb(trail: Trail, x_m: float, y_m: float) -> None:
    """Store this place if the newest point is a spacing away."""
    if trail.count and distance_m(trail, x_m, y_m) < trail.spacing_m:
        return
    if trail.count >= LIMIT:
        thin(trail)
    trail.xs_m[trail.count] = x_m
    trail.ys_m[trail.count] = y_m
    trail.count += 1


def thin(trail: Trail) -> None:
    """Keep the start and every second point after it."""
    trail.count = (trail.count + 1) // 2
    for i in range(trail.count):
        trail.xs_m[i] = trail.xs_m[2 * i]
        trail.ys_m[i] = trail.ys_m[2 * i]
    trail.spacing_m *= 2.0


def distance_m(trail: Trail, x_m: float, y_m: float) -> float:
    """Return the distance to the newest point."""
    dx_m = x_m - trail.xs_m[trail.count - 1]
    dy_m = y_m - trail.ys_m[trail.count - 1]
    return sqrt(dx_m * dx_m + dy_m * dy_m)


def pass_crumb(trail: Trail, x_m: float, y_m: float) -> bool:
    """Remove the newest point when it is reached; return whether there is a new one.

    The start stays.
    """
    if trail.count < 2 or distance_m(trail, x_m, y_m) > PASSED_M:
        return False
    trail.count -= 1
    return True


HALF_TURN: Final = 0.5 * pi
HALT: Final = Twist(0.0, 0.0)
NEAR_M: Final = 1e-6


def toward(distance_m: float, bearing_rad: float, params: Params) -> tuple[float, float]:
    """Return speed and yaw rate towards a point (position controller of Secchi and Carelli).

    u = v tanh(k rho) cos(alpha), w = k_w alpha + v (tanh(k rho) / rho) sin(alpha) cos(alpha). The
    robot never drives backwards: if the point is behind it, it turns on the spot.
    """
    if not -HALF_TURN < bearing_rad < HALF_TURN:
        return 0.0, params.k_omega * bearing_rad
    if distance_m < NEAR_M:
        distance_m = NEAR_M
    speed_m_s = params.v_max_m_s * tanh(params.k_rho * distance_m)
    cosine, sine = cos_sin(bearing_rad)
    pull_rad_s = speed_m_s / distance_m * sine * cosine
    return speed_m_s * cosine, params.k_omega * bearing_rad + pull_rad_s


def into(
    distance_m: float, bearing_rad: float, approach_rad: float, params: Params
) -> tuple[float, float]:
    """Return speed and yaw rate towards a pose (controller of Aicardi et al., saturated).

    `approach_rad` is the direction of the goal relative to the final heading (theta_g).
    """
    if not -HALF_TURN < bearing_rad < HALF_TURN:
        return 0.0, params.pose_k_omega * bearing_rad
    if distance_m < NEAR_M:
        distance_m = NEAR_M
    speed_m_s = params.v_max_m_s * tanh(params.pose_k_rho * distance_m)
    cosine, sine = cos_sin(bearing_rad)
    sinc = sine / bearing_rad if bearing_rad != 0.0 else 1.0
    bend_rad = bearing_rad + params.pose_h * approach_rad
    pull_rad_s = speed_m_s / distance_m * sinc * cosine * bend_rad
    return speed_m_s * cosine, params.pose_k_omega * bearing_rad + pull_rad_s


def align(error_rad: float, params: Params) -> float:
    """Return the yaw rate of the final turn on the spot: fast, then slow, without overshoot."""
    size_rad = abs(error_rad)
    rate_rad_s = max(params.align_k * size_rad, params.align_min_rad_s)
    rate_rad_s = min(rate_rad_s, 0.5 * size_rad / params.period_s, params.yaw_max_rad_s)
    return rate_rad_s if error_rad > 0.0 else -rate_rad_s


def heading_error(wanted_rad: float, heading_rad: float) -> float:
    """Return the turn from a heading to the wanted one, wrapped."""
    return wrap(wanted_rad - heading_rad)


def limited(speed_m_s: float, yaw_rate_rad_s: float, params: Params) -> tuple[float, float]:
    """Scale a twist to the wheel and yaw limits by one factor, which keeps the curvature.

    The smaller wheel turns faster at the same speed, and the limit is one of its motor.
    """
    size_rad_s = abs(yaw_rate_rad_s)
    fastest_m_s = abs(speed_m_s) + 0.5 * params.track_m * size_rad_s
    left_share, right_share = wheel_shares(params)
    least_share = right_share if right_share < left_share else left_share
    limit_m_s = params.wheel_max_m_s * least_share
    factor = 1.0
    if fastest_m_s > limit_m_s:
        factor = limit_m_s / fastest_m_s
    if size_rad_s * factor > params.yaw_max_rad_s:
        factor = params.yaw_max_rad_s / size_rad_s
    return speed_m_s * factor, yaw_rate_rad_s * factor


def ramp(wanted: Twist, last: Twist, params: Params) -> Twist:
    """Return the twist nearest to the wanted one within the acceleration limit of a period.

    If the robot is to stop or to reverse, the speed changes first and the turn gets the rest of the
    limit: a robot that turned as well would roll on. Otherwise speed and turn change by one share.
    So a robot that slows down in order to turn, for instance beside a person, turns at once.
    """
    wanted_m_s, wanted_rad_s = wanted
    last_m_s, last_rad_s = last
    more_m_s, more_rad_s = wanted_m_s - last_m_s, wanted_rad_s - last_rad_s
    turn_m_s = 0.5 * params.track_m * abs(more_rad_s)
    can_m_s = params.accel_m_s2 * params.period_s
    if abs(more_m_s) + turn_m_s <= can_m_s:
        return wanted
    if last_m_s != 0.0 and wanted_m_s * last_m_s <= 0.0:
        slower_m_s = min(abs(more_m_s), abs(last_m_s), can_m_s)
        rest_m_s = can_m_s - slower_m_s
        share = rest_m_s / turn_m_s if rest_m_s < turn_m_s else 1.0
        speed_m_s = last_m_s + (slower_m_s if more_m_s > 0.0 else -slower_m_s)
        return Twist(speed_m_s, last_rad_s + share * more_rad_s)
    share = can_m_s / (abs(more_m_s) + turn_m_s)
    return Twist(last_m_s + share * more_m_s, last_rad_s + share * more_rad_s)


SQUARE_M: Final = 2.0
SQUARES: Final = 32
"""On a side, after which the pattern repeats."""
GAINLESS_MS: Final = 180_000
SQUARE_MS: Final = 40_000
"""A robot that drives four times through all squares that it knows takes this for each."""


class ProgressMonitor:
    """Place and time of the last real motion, and the shortest distance to the goal so far.

    `seen` has a bit for each square of 2 m in which the robot has been, `squares` is their number,
    and `gained_ms` the time of the last new one, or of a shorter distance.
    """

    __slots__ = ("anchor", "best_m", "best_ms", "gained_ms", "moved_ms", "seen", "squares")

    def __init__(self) -> None:
        self.anchor = Pose(0.0, 0.0, 0.0)
        self.moved_ms = self.best_ms = self.gained_ms = self.squares = 0
        self.best_m = inf
        self.seen = bytearray(SQUARES * SQUARES // 8)


def restart(progress: ProgressMonitor, pose: Pose, now_ms: int) -> None:
    """Restart the timers: for a new goal, a new part of the trail, or after a hold."""
    progress.anchor = pose
    progress.best_m = inf
    progress.moved_ms = progress.best_ms = progress.gained_ms = now_ms
    progress.squares = 0
    for i in range(len(progress.seen)):
        progress.seen[i] = 0


def explore(progress: ProgressMonitor, pose: Pose) -> bool:
    """Note the square of this place; return whether it is new."""
    column, row = int(pose.x_m // SQUARE_M) % SQUARES, int(pose.y_m // SQUARE_M) % SQUARES
    i, bit = (row * SQUARES + column) // 8, 1 << column % 8
    if progress.seen[i] & bit:
        return False
    progress.seen[i] |= bit
    progress.squares += 1
    return True


def judge(
    progress: ProgressMonitor,
    pose: Pose,
    distance_m: float,
    now_ms: int,
    params: Params,
    patient: bool = False,
) -> int:
    """Return BLOCKED, NO_PROGRESS, LOST, or 0.

    `patient`: the navigator detects a lack of progress itself. LOST is returned instead of
    NO_PROGRESS, once the robot has been in no new place for as long as several ways along all
    places where it has been take.
    """
    if explore(progress, pose):
        progress.gained_ms = now_ms
    if distance_m < progress.best_m - params.progress_m:
        progress.best_m = distance_m
        progress.best_ms = progress.gained_ms = now_ms
    if got_away(progress.anchor, pose, params):
        progress.anchor = pose
        progress.moved_ms = now_ms
    if now_ms - progress.moved_ms > params.stuck_ms:
        return reasons.BLOCKED
    if patient:
        if now_ms - progress.gained_ms > GAINLESS_MS + SQUARE_MS * progress.squares:
            return reasons.LOST
    elif now_ms - progress.best_ms > params.progress_ms:
        return reasons.NO_PROGRESS
    return reasons.OK


def got_away(anchor: Pose, pose: Pose, params: Params) -> bool:
    """Return whether the robot has moved or turned far enough from the anchor."""
    x_m, y_m, heading_rad = pose
    from_x_m, from_y_m, from_rad = anchor
    dx_m, dy_m, stuck_m = x_m - from_x_m, y_m - from_y_m, params.stuck_m
    if dx_m * dx_m + dy_m * dy_m >= stuck_m * stuck_m:
        return True
    return abs(wrap(heading_rad - from_rad)) >= params.stuck_rad
