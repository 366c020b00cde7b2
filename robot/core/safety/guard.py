"""The guard: the last stage before the wheels, which may only reduce speed."""

from typing import Final

from robot.core import reasons, states
from robot.core.parameters import Params
from robot.core.perception.sonar_ring import AHEAD, FRONT, Ring
from robot.core.values import COSINES, Wheels

ROUNDING: Final = 1.0 + 1e-9  # tolerates rounding of a command at the limit
FRONT_BUMPER: Final = states.BUMPER_LEFT | states.BUMPER_RIGHT
REAR_BUMPER: Final = states.BUMPER_REAR


def limit(
    speed_m_s: float,
    yaw_rate_rad_s: float,
    ring: Ring,
    wheels: Wheels | None,
    params: Params,
) -> tuple[float, int]:
    """Return the factor 0..1 for both wheels, which keeps the curvature, and its reason."""
    fastest_m_s = abs(speed_m_s) + 0.5 * params.track_m * abs(yaw_rate_rad_s)
    if fastest_m_s == 0.0:
        return 1.0, reasons.OK
    if fastest_m_s - fastest_m_s != 0.0:
        return 0.0, reasons.NOT_FINITE
    if wheels is None or ring.fresh == 0:
        return 0.0, reasons.NO_SENSES
    factor, reason = 1.0, reasons.OK
    if fastest_m_s > params.wheel_max_m_s * ROUNDING:
        factor, reason = params.wheel_max_m_s / fastest_m_s, reasons.WHEEL_LIMIT
    if speed_m_s > 0.0:
        if wheels.bumper & FRONT_BUMPER:
            return 0.0, reasons.BUMPER
        room = forward_factor(speed_m_s, ring, params)
        if room < factor:
            return room, reasons.SLOWED if room > 0.0 else reasons.OBSTACLE_AHEAD
    elif speed_m_s < 0.0 and wheels.bumper & REAR_BUMPER:
        return 0.0, reasons.BUMPER
    return factor, reason


def forward_factor(speed_m_s: float, ring: Ring, params: Params) -> float:
    """Return the share of the forward speed that the echoes ahead permit.

    An echo may approach, by its own motion and the robot's, only so fast that it takes at least
    `guard_time_s` to reach `guard_stop_m`. Without any measurement ahead the share is 0.
    """
    if all_missing(ring):
        return 0.0
    stop_m, time_s = params.guard_stop_m, params.guard_time_s
    if stop_m <= 0.0:
        return 1.0
    factor = 1.0
    for i in FRONT:
        range_m = ring.range_m[i]
        if range_m is not None:
            closing_m_s = speed_m_s * COSINES[i]
            may_m_s = (range_m - stop_m) / time_s - ring.approach_m_s[i]
            if may_m_s < closing_m_s * factor:
                factor = max(may_m_s, 0.0) / closing_m_s
    return factor


def all_missing(ring: Ring) -> bool:
    """Return whether both sonars ahead have no measurement."""
    return ring.range_m[AHEAD[0]] is None and ring.range_m[AHEAD[1]] is None
