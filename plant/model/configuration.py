"""Body, noise and faults of the robots: default values, with the overrides of a world's file."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import inf, isfinite, pi, radians
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from protocol.ring import RADIUS_M
from protocol.world import Settings, World

INT32: Final = 1 << 31

MAX_SPIN_RAD_S: Final = 1e4
"""Largest speed of turning on the spot: the sine of a turn in one period must be defined."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """The nominal robot; `plant.model.configuration` describes its deviations.

    Motors whose command has expired are short-circuited and slow down by `brake_m_s2`.

    Raises ValueError, naming the field, for a dimension that is not finite or not possible.
    """

    radius_m: float = RADIUS_M
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """One level of noise; the default values are no noise.

    A range has a Gaussian error of `range_sigma_m + range_sigma_ratio * range`. An echo is lost
    with `dropout_probability`, comes too early with `ghost_probability`, and never comes from a
    surface met more obliquely than `incidence_limit_rad`. Each wheel slips with a variance of
    `slip_variance_m` square metres per metre; the right wheel is larger than the left by
    `diameter_difference_ratio`.

    Raises ValueError, naming the field, for a value out of its range.
    """

    range_sigma_m: float = 0.0
    range_sigma_ratio: float = 0.0
    dropout_probability: float = 0.0
    ghost_probability: float = 0.0
    incidence_limit_rad: float = pi / 2
    slip_variance_m: float = 0.0
    diameter_difference_ratio: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value, limit = getattr(self, field.name), UPPER_LIMITS[field.name]
            lowest = -limit if field.name == "diameter_difference_ratio" else 0.0
            if not isfinite(value) or not lowest <= value <= limit:
                raise ValueError(f"{field.name}: {value} is not within {lowest:g} to {limit:g}")


UPPER_LIMITS: Final[Mapping[str, float]] = MappingProxyType(
    {
        "range_sigma_m": 1.0,
        "range_sigma_ratio": 1.0,
        "dropout_probability": 1.0,
        "ghost_probability": 1.0,
        "incidence_limit_rad": pi / 2,
        "slip_variance_m": 0.01,
        "diameter_difference_ratio": 0.2,
    }
)

LEVELS: Final[Mapping[str, Noise]] = MappingProxyType(
    {
        "none": Noise(),
        "default": Noise(
            range_sigma_m=0.003,
            range_sigma_ratio=0.01,
            dropout_probability=0.005,
            ghost_probability=0.001,
            slip_variance_m=2e-6,
        ),
        "lossy": Noise(
            range_sigma_m=0.003,
            range_sigma_ratio=0.01,
            dropout_probability=0.005,
            ghost_probability=0.001,
            incidence_limit_rad=radians(40.0),
            slip_variance_m=2e-6,
        ),
        "harsh": Noise(
            range_sigma_m=0.010,
            range_sigma_ratio=0.02,
            dropout_probability=0.03,
            ghost_probability=0.01,
            incidence_limit_rad=radians(40.0),
            slip_variance_m=2e-5,
            diameter_difference_ratio=0.005,
        ),
    }
)


SONAR_TARGETS: Final = ("0", "1", "2", "3", "4", "5", "6", "7", "all")
WHEEL_TARGETS: Final = ("left", "right", "both")
NO_TARGETS: Final = ("",)


class FaultKind(NamedTuple):
    """Valid targets of a fault, range and unit of its value, and its effect."""

    targets: tuple[str, ...]
    lowest: float
    highest: float
    unit: str
    doc: str


KINDS: Final[Mapping[str, FaultKind]] = MappingProxyType(
    {
        "sonar_dead": FaultKind(SONAR_TARGETS, 0, 0, "", "gives no readings"),
        "sonar_frozen": FaultKind(SONAR_TARGETS, 0, 0, "", "repeats its last measurement"),
        "sonar_fixed": FaultKind(SONAR_TARGETS, 0, 60, "m", "always measures this range"),
        "sonar_offset": FaultKind(SONAR_TARGETS, -60, 60, "m", "measures this much too far"),
        "sonar_dropout": FaultKind(SONAR_TARGETS, 0, 1, "", "loses echoes with this probability"),
        "encoder_stuck": FaultKind(WHEEL_TARGETS, 0, 0, "", "stops counting"),
        "encoder_jump": FaultKind(WHEEL_TARGETS, -(2**31), 2**31 - 1, "ticks", "jumps, once"),
        "wheel_slip": FaultKind(
            WHEEL_TARGETS, 0, 1, "", "loses this share of its path on the ground"
        ),
        "wheel_stuck": FaultKind(WHEEL_TARGETS, 0, 0, "", "does not turn"),
        "ticks_stopped": FaultKind(NO_TARGETS, 0, 0, "", "no wheel ticks are published"),
        "scan_stopped": FaultKind(NO_TARGETS, 0, 0, "", "no sonar scan is published"),
        "bumper_stuck": FaultKind(
            NO_TARGETS, 1, 7, "", "reads pressed: 1 left + 2 front + 4 right"
        ),
    }
)


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault, in force from `start_s` until before `end_s` of simulated time.

    `target` is a sonar ("0" to "7", "all"), a wheel ("left", "right", "both") or "". Raises
    ValueError, naming the field, for an unknown fault or a value out of range.
    """

    kind: str
    target: str = ""
    start_s: float = 0.0
    end_s: float = inf
    value: float = 0.0
    robot: int = 0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"kind: no fault {self.kind!r}; there are {', '.join(KINDS)}")
        kind = KINDS[self.kind]
        if self.target not in kind.targets:
            wanted = ", ".join(repr(target) for target in kind.targets)
            raise ValueError(f"target: {self.target!r} is none of {wanted} for {self.kind}")
        if not isfinite(self.start_s) or self.start_s < 0.0:
            raise ValueError(f"start_s: {self.start_s} is not a time")
        if not self.end_s > self.start_s:
            raise ValueError(f"end_s: {self.end_s} is not after start_s")
        if not kind.lowest <= self.value <= kind.highest:
            limits = f"{kind.lowest:g} to {kind.highest:g} {kind.unit}".rstrip()
            raise ValueError(f"value: {self.value} is not within {limits} for {self.kind}")
        if self.robot < 0:
            raise ValueError(f"robot: {self.robot} is not the number of a robot")


USUAL_LEVEL: Final = "default"


def body_of(world: World) -> Body:
    """Return the robot of a world: the default body with the overrides of the file."""
    return Body(**_fields(world.robot))


def noise_of(world: World, level: str | None = None) -> Noise:
    """Return the requested noise level, else that of the file, else the default level."""
    if level is not None:
        return LEVELS[level]
    settings = _fields(world.noise)
    return replace(LEVELS[settings.pop("level", USUAL_LEVEL)], **settings)


def faults_of(world: World) -> tuple[Fault, ...]:
    """Return the faults of a world's file."""
    return tuple(Fault(**_fields(settings)) for settings in world.faults)


def _fields(settings: Settings) -> dict[str, Any]:
    return dict(settings)
