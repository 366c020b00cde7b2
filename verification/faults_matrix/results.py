"""What one repetition showed, kept line by line in a file, so that an interrupted run goes on."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

from protocol.wire.reasons import Reason
from verification.faults_matrix.table import Fault, Must, Way

TOUCH_S = 0.5
"""From a contact to standing wheels: a tick, and braking."""
EPSILON_S = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Repetition:
    """Times from the fault on; None: it did not happen, or nobody could see it.

    `touched_s` is from the first contact to standing wheels. `moved_again` says that it did not
    stay where it stood, also when the fault was over. `lost` and `lost_events` are frames that were
    sent and are not in the log, `unlogged_s` is the time at its end that it lacks. `missed_ticks`
    are control periods that the robot missed, where that is judged.
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

    def misses(self, fault: Fault) -> list[str]:
        """What was not as it must be, in words; empty when all was."""
        if self.trouble:
            return [self.trouble]
        found = [f"{self.contacts} contacts"] if self.contacts and not may_touch(fault) else []
        if fault.must in (Must.STOP, Must.STAND, Must.SAY):
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

    def _late(self, fault: Fault) -> list[str]:
        found = ["moved again"] if self.moved_again else []
        names = [reason.name for reason in fault.reasons]
        if names and self.reason not in names:
            found.append(f"called it {self.reason or 'nothing'}")
        if fault.within_s is not None and not fault.unseen:
            found += over("known", self.known_s, fault.within_s)
        if fault.stands_s is not None:
            found += over("stood", self.stood_s, fault.stands_s)
        return found


def may_touch(fault: Fault) -> bool:
    return fault.must is Must.TOUCH_AT_MOST


def over(what: str, took_s: float | None, limit_s: float) -> list[str]:
    if took_s is None:
        return [f"never {what}"]
    if took_s > limit_s + EPSILON_S:
        return [f"{what} after {took_s * 1e3:.0f} ms, not {limit_s * 1e3:.0f}"]
    return []


class Results:
    """All repetitions so far. `add` writes each at once."""

    def __init__(self, path: Path | None, found: Iterable[Repetition] = ()) -> None:
        self._path = path
        self._found = {(one.fault, one.way, one.number): one for one in found}

    @classmethod
    def kept_in(cls, path: Path) -> Self:
        """What an earlier run left there; a line that was cut off is left out."""
        found = []
        if path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    found.append(Repetition(**json.loads(line)))
                except (ValueError, TypeError):
                    continue
        return cls(path, found)

    def add(self, one: Repetition) -> None:
        self._found[one.fault, one.way, one.number] = one
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(one)) + "\n")

    def has(self, fault: str, way: Way, number: int) -> bool:
        """Is there such a repetition, by the name of its fault?"""
        return (fault, way.value, number) in self._found

    def of(self, fault: Fault, way: Way) -> list[Repetition]:
        key = (fault.name, way.value)
        return [one for one in self._found.values() if (one.fault, one.way) == key]


def reason_name(number: int) -> str:
    """The name of a reason, empty for none."""
    return Reason(number).name if number else ""
