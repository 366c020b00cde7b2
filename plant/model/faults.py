"""Faults that can be injected into a robot, by name, with time, target and value."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite
from types import MappingProxyType
from typing import Final, NamedTuple

SONAR_TARGETS: Final = ("0", "1", "2", "3", "4", "5", "6", "7", "all")
WHEEL_TARGETS: Final = ("left", "right", "both")
NO_TARGETS: Final = ("",)


class Kind(NamedTuple):
    """Valid targets of a fault, range and unit of its value, and its effect."""

    targets: tuple[str, ...]
    lowest: float
    highest: float
    unit: str
    doc: str


KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {
        "sonar_dead": Kind(SONAR_TARGETS, 0, 0, "", "gives no readings"),
        "sonar_frozen": Kind(SONAR_TARGETS, 0, 0, "", "repeats its last measurement"),
        "sonar_fixed": Kind(SONAR_TARGETS, 0, 60, "m", "always measures this range"),
        "sonar_offset": Kind(SONAR_TARGETS, -60, 60, "m", "measures this much too far"),
        "sonar_dropout": Kind(SONAR_TARGETS, 0, 1, "", "loses echoes with this probability"),
        "encoder_stuck": Kind(WHEEL_TARGETS, 0, 0, "", "stops counting"),
        "encoder_jump": Kind(WHEEL_TARGETS, -(2**31), 2**31 - 1, "ticks", "jumps, once"),
        "wheel_slip": Kind(WHEEL_TARGETS, 0, 1, "", "loses this share of its path on the ground"),
        "wheel_stuck": Kind(WHEEL_TARGETS, 0, 0, "", "does not turn"),
        "ticks_stopped": Kind(NO_TARGETS, 0, 0, "", "no wheel ticks are published"),
        "scan_stopped": Kind(NO_TARGETS, 0, 0, "", "no sonar scan is published"),
        "bumper_stuck": Kind(NO_TARGETS, 1, 7, "", "reads pressed: 1 left + 2 front + 4 right"),
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
