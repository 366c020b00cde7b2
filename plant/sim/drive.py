"""Differential drive: two motors with lag and limits, wheel slip, and encoders.

The encoders count the rotation of the wheels. The motion on the ground is what remains after slip,
with the true wheel diameters. This module has no access to sensors or the pose.
"""

from math import copysign, floor, sqrt

from plant.model.configuration import INT32, Body, Noise
from plant.sim.active_faults import NO_TROUBLE, ActiveFaults
from plant.sim.seeds import gaussian_rows
from runtime.elementary import exp
from runtime.units import NS_PER_MS


class Motor:
    """Rim speed of one wheel: first-order lag behind the command, exact for any step.

    d(speed)/dt = (wanted - speed) / lag, limited by the acceleration limit.
    """

    __slots__ = (
        "_acceleration_m_s2",
        "_lag_s",
        "_left_share",
        "_linear_m_s",
        "_span_s",
        "speed_m_s",
    )

    def __init__(self, body: Body) -> None:
        self.speed_m_s = 0.0
        self._lag_s = body.motor_lag_s
        self._acceleration_m_s2 = body.max_acceleration_m_s2
        self._linear_m_s = body.max_acceleration_m_s2 * body.motor_lag_s
        self._span_s = self._left_share = 0.0

    def turn(self, wanted_m_s: float, span_s: float) -> float:
        """Run for a time and return the path of the rim in metres."""
        way_m, missing_m_s = 0.0, wanted_m_s - self.speed_m_s
        if abs(missing_m_s) > self._linear_m_s:
            ramp_s = (abs(missing_m_s) - self._linear_m_s) / self._acceleration_m_s2
            acceleration_m_s2 = copysign(self._acceleration_m_s2, missing_m_s)
            if ramp_s >= span_s:
                return self._ramp(acceleration_m_s2, span_s)
            way_m = self._ramp(acceleration_m_s2, ramp_s)
            span_s -= ramp_s
            missing_m_s = wanted_m_s - self.speed_m_s
        if span_s != self._span_s:  # whole substeps, mostly
            self._span_s = span_s
            self._left_share = exp(-span_s / self._lag_s) if self._lag_s else 0.0
        left_m_s = missing_m_s * self._left_share
        self.speed_m_s = wanted_m_s - left_m_s
        return way_m + (wanted_m_s * span_s - self._lag_s * (missing_m_s - left_m_s))

    def _ramp(self, acceleration_m_s2: float, span_s: float) -> float:
        gain_m_s = acceleration_m_s2 * span_s
        way_m = (self.speed_m_s + 0.5 * gain_m_s) * span_s
        self.speed_m_s += gain_m_s
        return way_m

    def brake(self, deceleration_m_s2: float, span_s: float) -> float:
        """Run short-circuited for a time and return the path of the rim in metres."""
        braking_s = min(span_s, abs(self.speed_m_s) / deceleration_m_s2)
        lost_m_s = copysign(deceleration_m_s2 * braking_s, self.speed_m_s)
        way_m = (self.speed_m_s - 0.5 * lost_m_s) * braking_s
        self.speed_m_s = self.speed_m_s - lost_m_s if braking_s == span_s else 0.0
        return way_m


class DifferentialDrive:
    """Two motors with one driver board, their encoders and their motion on the ground."""

    __slots__ = (
        *("_brake_m_s2", "_counted_m", "_expires_ns", "_limit_m_s", "_m_per_mrad", "_motors"),
        *("_scales", "_slip_m", "_slips", "_start_ticks", "_ticks_per_m", "_wanted_m_s", "expired"),
    )

    def __init__(self, body: Body, noise: Noise, seed: int, robot: int) -> None:
        self._limit_m_s, self._brake_m_s2 = body.max_speed_m_s, body.brake_m_s2
        self._m_per_mrad = body.wheel_radius_m / 1000.0
        self._ticks_per_m = body.ticks_per_m
        self._start_ticks = (body.left_start_ticks, body.right_start_ticks)
        self._motors = (Motor(body), Motor(body))
        self._wanted_m_s = (0.0, 0.0)
        self._expires_ns = -1
        self._counted_m = [0.0, 0.0]
        half = noise.diameter_difference_ratio / 2.0
        self._scales = (1.0 - half, 1.0 + half)
        self._slip_m = noise.slip_variance_m
        self._slips = gaussian_rows(seed, robot, "slip", 2)
        self.expired = False

    def command(self, left_mrad_s: int, right_mrad_s: int, ttl_ms: int, now_ns: int) -> None:
        """Set the wheel speeds, within their limit, until the time-to-live expires."""
        limit_m_s, m_per_mrad = self._limit_m_s, self._m_per_mrad
        self._wanted_m_s = (
            _within(left_mrad_s * m_per_mrad, limit_m_s),
            _within(right_mrad_s * m_per_mrad, limit_m_s),
        )
        self._expires_ns = now_ns + ttl_ms * NS_PER_MS
        self.expired = False

    def roll(self, now_ns: int, span_s: float, trouble: ActiveFaults) -> tuple[float, float]:
        """Run the motors for a time; return the paths of both wheels on the ground in metres."""
        if now_ns < self._expires_ns:
            self.expired = False
            (left, right), (left_m_s, right_m_s) = self._motors, self._wanted_m_s
            left_m, right_m = left.turn(left_m_s, span_s), right.turn(right_m_s, span_s)
        else:
            self.expired = self._expires_ns >= 0
            left_m, right_m = (motor.brake(self._brake_m_s2, span_s) for motor in self._motors)
        if trouble is not NO_TROUBLE:
            left_m, right_m = self._jammed(left_m, right_m, trouble)
        else:
            self._counted_m[0] += left_m
            self._counted_m[1] += right_m
        left_m *= self._scales[0]
        right_m *= self._scales[1]
        if self._slip_m > 0.0:
            left_slip, right_slip = self._slips.next()
            left_m += sqrt(self._slip_m * abs(left_m)) * left_slip
            right_m += sqrt(self._slip_m * abs(right_m)) * right_slip
        if trouble is not NO_TROUBLE:
            return left_m * (1.0 - trouble.slip[0]), right_m * (1.0 - trouble.slip[1])
        return left_m, right_m

    def ticks(self, jumped_ticks: tuple[int, int] = (0, 0)) -> tuple[int, int]:
        """Return the encoder counters, with faulty jumps added, wrapped to 32 bits."""
        per_m = self._ticks_per_m
        left = floor(self._counted_m[0] * per_m) + self._start_ticks[0] + jumped_ticks[0]
        right = floor(self._counted_m[1] * per_m) + self._start_ticks[1] + jumped_ticks[1]
        return _wrapped(left), _wrapped(right)

    def _jammed(self, left_m: float, right_m: float, trouble: ActiveFaults) -> tuple[float, float]:
        ways_m = [left_m, right_m]
        for side in (0, 1):
            if trouble.wheel_stuck[side]:
                self._motors[side].speed_m_s = 0.0
                ways_m[side] = 0.0
            if not trouble.encoder_stuck[side]:
                self._counted_m[side] += ways_m[side]
        return ways_m[0], ways_m[1]


def _within(speed_m_s: float, limit_m_s: float) -> float:
    """Limit a speed by comparisons: min() and max() would dominate the cost of a command."""
    if speed_m_s > limit_m_s:
        return limit_m_s
    return speed_m_s if speed_m_s > -limit_m_s else -limit_m_s


def _wrapped(count: int) -> int:
    return (count + INT32) % (2 * INT32) - INT32
