"""The result of one repetition, saved line by line so that an interrupted run can continue."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

from checks.faults.table import FaultCase, Must, Way
from protocol.wire.reasons import Reason

TOUCH_S = 0.5
"""Limit from a contact until the wheels stop: a tick, and braking."""
EPSILON_S = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Repetition:
    """The reaction to a fault; times are from the fault, None if not observed.

    `known_s` is the time until the robot reported a stop, `stood_s` until its wheels stopped, and
    `touched_s` from the first contact until then. `moved_again`: the robot moved after it had
    stopped, perhaps after the end of the fault. `lost` and `lost_events` are frames that were sent
    but are not in the log; `unlogged_s` is the time missing at its end. `missed_ticks` are control
    periods that the robot missed, where that is judged.
    """

    fault: str
    way: str
    number: int
    known_s: float | None = None
    stood_s: float | None = None
    distance_m: float | None = None
    reason: str = ""
    reached: bool = False
    contacts: int = 0
    touched_s: float | None = None
    moved_again: bool = False
    logged: int | None = None
    lost: int | None = None
    lost_events: int | None = None
    unlogged_s: float | None = None
    missed_ticks: int | None = None
    trouble: str = ""

    def misses(self, fault: FaultCase) -> list[str]:
        """Return how the repetition misses its requirement, in words; empty if it does not."""
        if self.trouble:
            return [self.trouble]
        found = [f"{self.contacts} contacts"] if self.contacts and not may_touch(fault) else []
        if fault.must_stop:
            return found + self._late(fault)
        if self.missed_ticks:
            found.append(f"missed {self.missed_ticks} ticks")
        if fault.must in (Must.GO_ON, Must.KEEP_TIME):
            return found + ([] if self.reached else [f"did not arrive ({self.reason or 'late'})"])
        if not self.reached and not self.reason:
            found.append("neither arrived nor stopped with a reason")
        if self.touched_s is not None and self.touched_s > TOUCH_S + EPSILON_S:
            found.append(f"drove on for {self.touched_s:.2f} s after a contact")
        return found

    def _late(self, fault: FaultCase) -> list[str]:
        found = ["moved again"] if self.moved_again else []
        names = [reason.name for reason in fault.reasons]
        if names and self.reason not in names:
            found.append(f"reported {self.reason or 'no reason'}")
        if fault.within_s is not None and not fault.unseen:
            found += over("known", self.known_s, fault.within_s)
        if fault.stands_s is not None:
            found += over("stopped", self.stood_s, fault.stands_s)
        return found


def may_touch(fault: FaultCase) -> bool:
    """Return whether a fault may end in a contact."""
    return fault.must is Must.TOUCH_AT_MOST


def over(what: str, took_s: float | None, limit_s: float) -> list[str]:
    """Return how a time exceeds its limit, in words; empty if it does not."""
    if took_s is None:
        return [f"never {what}"]
    if took_s > limit_s + EPSILON_S:
        return [f"{what} after {took_s * 1e3:.0f} ms, not {limit_s * 1e3:.0f}"]
    return []


class Results:
    """All repetitions so far, optionally saved in a file."""

    def __init__(self, path: Path | None, found: Iterable[Repetition] = ()) -> None:
        self._path = path
        self._found = {(one.fault, one.way, one.number): one for one in found}

    @classmethod
    def kept_in(cls, path: Path) -> Self:
        """Load the repetitions of an earlier run; incomplete lines are skipped."""
        found = []
        if path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    found.append(Repetition(**json.loads(line)))
                except (ValueError, TypeError):
                    continue
        return cls(path, found)

    def add(self, one: Repetition) -> None:
        """Add a repetition and save it at once."""
        self._found[one.fault, one.way, one.number] = one
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(one)) + "\n")

    def has(self, fault: str, way: Way, number: int) -> bool:
        """Return whether there is such a repetition, by the name of its fault."""
        return (fault, way.value, number) in self._found

    def of(self, fault: FaultCase, way: Way) -> list[Repetition]:
        """Return the repetitions of a fault."""
        key = (fault.name, way.value)
        return [one for one in self._found.values() if (one.fault, one.way) == key]


def reason_name(number: int) -> str:
    """Return the name of a reason; empty for none."""
    return Reason(number).name if number else ""
