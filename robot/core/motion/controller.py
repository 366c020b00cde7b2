"""Compute speed and yaw rate towards a point or pose, within the limits of the wheels."""

from math import pi
from typing import Final

from robot.core.geometry import wrap
from robot.core.parameters import Params
from robot.core.perception.odometry import wheel_shares
from robot.core.values import Twist
from runtime.elementary import cos_sin, tanh

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
    more_m_s = wanted.speed_m_s - last.speed_m_s
    more_rad_s = wanted.yaw_rate_rad_s - last.yaw_rate_rad_s
    turn_m_s = 0.5 * params.track_m * abs(more_rad_s)
    can_m_s = params.accel_m_s2 * params.period_s
    if abs(more_m_s) + turn_m_s <= can_m_s:
        return wanted
    if last.speed_m_s != 0.0 and wanted.speed_m_s * last.speed_m_s <= 0.0:
        slower_m_s = min(abs(more_m_s), abs(last.speed_m_s), can_m_s)
        rest_m_s = can_m_s - slower_m_s
        share = rest_m_s / turn_m_s if rest_m_s < turn_m_s else 1.0
        speed_m_s = last.speed_m_s + (slower_m_s if more_m_s > 0.0 else -slower_m_s)
        return Twist(speed_m_s, last.yaw_rate_rad_s + share * more_rad_s)
    share = can_m_s / (abs(more_m_s) + turn_m_s)
    return Twist(last.speed_m_s + share * more_m_s, last.yaw_rate_rad_s + share * more_rad_s)
