"""The faults of one robot in force at a time, combined by affected part."""

from collections.abc import Iterable
from math import isfinite
from typing import Final, NamedTuple, TypeAlias

from plant.model.configuration import Fault
from protocol.ring import SONARS
from runtime.units import NS_PER_S

NEVER_NS: Final = 1 << 63
PAIR: Final = {"left": (True, False), "right": (False, True), "both": (True, True)}

Flags: TypeAlias = tuple[bool, bool]
Values: TypeAlias = tuple[float | None, ...]


class SonarFaults(NamedTuple):
    """Faults per sonar; None or False for a sonar without one."""

    dead: tuple[bool, ...]
    frozen: tuple[bool, ...]
    fixed_m: Values
    offset_m: Values
    dropout: Values


class ActiveFaults(NamedTuple):
    """Faults of all parts, left and right wheel separately.

    `jumped_ticks` sums every encoder jump since the start.
    """

    sonar: SonarFaults | None = None
    encoder_stuck: Flags = (False, False)
    jumped_ticks: tuple[int, int] = (0, 0)
    slip: tuple[float, float] = (0.0, 0.0)
    wheel_stuck: Flags = (False, False)
    ticks_stopped: bool = False
    scan_stopped: bool = False
    bumper: int = 0


NO_TROUBLE: Final = ActiveFaults()


class FaultSchedule:
    """The faults of one robot; recomputed only when one begins or ends."""

    __slots__ = ("_changes_ns", "_faults", "_trouble")

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._faults = list(faults)
        self._trouble = NO_TROUBLE
        self._changes_ns = 0

    def add(self, fault: Fault) -> None:
        """Add a fault."""
        self._faults.append(fault)
        self._changes_ns = 0

    def clear(self, now_ns: int) -> None:
        """Drop every fault; past encoder jumps remain in the counters."""
        self._faults = [
            fault
            for fault in self._faults
            if fault.kind == "encoder_jump" and start_ns(fault) <= now_ns
        ]
        self._changes_ns = 0

    def at(self, now_ns: int) -> ActiveFaults:
        """Return the faults in force at a time."""
        if now_ns >= self._changes_ns:
            moments = [
                moment for fault in self._faults for moment in (start_ns(fault), end_ns(fault))
            ]
            self._changes_ns = min((m for m in moments if m > now_ns), default=NEVER_NS)
            self._trouble = _added_up(self._faults, now_ns)
        return self._trouble


def start_ns(fault: Fault) -> int:
    """Return the start of a fault."""
    return round(fault.start_s * NS_PER_S)


def end_ns(fault: Fault) -> int:
    """Return the end of a fault; NEVER_NS if it is endless."""
    return round(fault.end_s * NS_PER_S) if isfinite(fault.end_s) else NEVER_NS


def _added_up(faults: list[Fault], now_ns: int) -> ActiveFaults:
    started = [fault for fault in faults if start_ns(fault) <= now_ns]
    active = [fault for fault in started if now_ns < end_ns(fault)]
    if not started:
        return NO_TROUBLE
    kinds = {fault.kind for fault in active}
    return ActiveFaults(
        sonar=_sonars(active) if any(kind.startswith("sonar_") for kind in kinds) else None,
        encoder_stuck=_flags(active, "encoder_stuck"),
        jumped_ticks=_jumps(started),
        slip=(_slip(active, 0), _slip(active, 1)),
        wheel_stuck=_flags(active, "wheel_stuck"),
        ticks_stopped="ticks_stopped" in kinds,
        scan_stopped="scan_stopped" in kinds,
        bumper=_pressed(active),
    )


def _flags(active: list[Fault], kind: str) -> Flags:
    pairs = [PAIR[fault.target] for fault in active if fault.kind == kind]
    return any(left for left, _ in pairs), any(right for _, right in pairs)


def _jumps(started: list[Fault]) -> tuple[int, int]:
    jumps = [(PAIR[one.target], int(one.value)) for one in started if one.kind == "encoder_jump"]
    return sum(n for (left, _), n in jumps if left), sum(n for (_, right), n in jumps if right)


def _slip(active: list[Fault], side: int) -> float:
    kept = 1.0
    for fault in active:
        if fault.kind == "wheel_slip" and PAIR[fault.target][side]:
            kept *= 1.0 - fault.value
    return 1.0 - kept


def _pressed(active: list[Fault]) -> int:
    sectors = 0
    for fault in active:
        if fault.kind == "bumper_stuck":
            sectors |= int(fault.value)
    return sectors


def _sonars(active: list[Fault]) -> SonarFaults:
    def last(kind: str) -> Values:
        """Return, per sonar, the value of the latest fault of that kind."""
        values: list[float | None] = [None] * SONARS
        for fault in active:
            if fault.kind == kind:
                for sonar in range(SONARS) if fault.target == "all" else (int(fault.target),):
                    values[sonar] = fault.value
        return tuple(values)

    dead, frozen = last("sonar_dead"), last("sonar_frozen")
    return SonarFaults(
        dead=tuple(value is not None for value in dead),
        frozen=tuple(value is not None for value in frozen),
        fixed_m=last("sonar_fixed"),
        offset_m=last("sonar_offset"),
        dropout=last("sonar_dropout"),
    )
