"""Properties of the robot: dimensions, motors, encoders and range of its sonars."""

from dataclasses import dataclass, fields
from math import isfinite
from typing import Final

INT32: Final = 1 << 31

MAX_SPIN_RAD_S: Final = 1e4
"""Largest speed of turning on the spot: the sine of a turn in one period must be defined."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """The nominal robot; `plant.model.noise` describes its deviations.

    Motors whose command has expired are short-circuited and slow down by `brake_m_s2`.

    Raises ValueError, naming the field, for a dimension that is not finite or not possible.
    """

    radius_m: float = 0.12
    track_m: float = 0.20
    wheel_radius_m: float = 0.033
    max_speed_m_s: float = 0.30
    max_acceleration_m_s2: float = 1.5
    brake_m_s2: float = 8.0
    motor_lag_s: float = 0.05
    ticks_per_m: float = 5000.0
    left_start_ticks: int = 0
    right_start_ticks: int = 0
    sonar_min_m: float = 0.02
    sonar_max_m: float = 3.0

    def __post_init__(self) -> None:
        for field in fields(self):
            _check(field.name, getattr(self, field.name))
        if self.track_m > 2.0 * self.radius_m:
            raise ValueError(f"track_m: {self.track_m} is wider than the robot (2 * radius_m)")
        if self.max_speed_m_s > MAX_SPIN_RAD_S * self.track_m / 2.0:
            raise ValueError(f"track_m: {self.track_m} is too narrow for max_speed_m_s")
        if not self.sonar_min_m < self.sonar_max_m <= 60.0:
            raise ValueError("sonar_max_m: must be above sonar_min_m and at most 60")


def _check(name: str, value: float) -> None:
    if name.endswith("_ticks"):
        if not -INT32 <= value < INT32:
            raise ValueError(f"{name}: {value} does not fit 32 bits")
    elif not isfinite(value):
        raise ValueError(f"{name}: {value} is not finite")
    elif value < 0.0 or (value == 0.0 and name not in ("motor_lag_s", "sonar_min_m")):
        raise ValueError(f"{name}: {value} must be above zero")
