"""Results of the fault matrix, saved line by line, and the page docs/evidence/faults.md of them.

An interrupted run continues from the saved lines. The page begins with the rows that miss a limit.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from typing import Final, Self

from checks.faults.cases import FAULTS, GROUPS, FaultCase, Must, Way
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


INTRODUCTION: Final = """\
# Faults

This page shows how the robot reacts to faults. It was measured by
`sidestep bench faults --page docs/evidence/faults.md`
on {date}
({machine}).
**In lockstep**, time is simulated, and the whole stack runs in one process over real sockets. The
number of the repetition seeds the time of the fault, its phase in the control period and the
noise, so a run is reproducible. **In wall time**, router, plant, robot, `goto` and recorder are
real processes on a shared machine. If the machine delays one of them for too long, the robot stops
with BUDGET or TICKS_LOST instead of the expected reason.

- *Known* is the time from the fault until the robot reports why it does not drive; *stopped* is
  the time until its wheels do not turn. Both are median and worst, in ms. The limit of *known* is
  that of the failsafe plus 100 ms, for the next sample that would be due and the tick that checks
  it. The limit of *stopped* adds 400 ms for braking from 0.3 m/s. After a fault of the robot's own
  process or of its link to the plant, the wheels must stop within 200 ms.
- *Path* is the longest path after the fault. After the robot had stopped, the fault ended (the
  process was resumed or restarted, the link restored), and the robot had to stay at rest.
- *Log* counts the frames that were sent but are missing in the recorder's log, samples and events,
  for the worst repetition. Samples sent while the link was cut cannot be recorded; events are
  fetched later.
- Loss, delay, duplication and reordering are injected by the bus itself (`[network.trouble]`) on
  arrival of each sample, because TCP turns loss into delay. A link between two processes is cut by
  dropping all their frames; a link to the router is cut by a TCP proxy that stops forwarding.
  `tests/compose` cuts, pauses and kills real containers.
- "Router impersonated" runs with access control: the process in the router's place has the key of
  another robot, enforces no access rules, and sends everything that could make the robot drive.
  `tests/bus/test_access.py` covers an impostor at the start. `sidestep bench flood` attacks a
  robot with access control.
- A robot that hangs with the GIL held, or that was killed, is restarted.
- In the rows of the emulated board, simulated time pauses while the robot waits for the board, at
  most 3 s. The times do not contain this wait.
"""
ROW: Final = re.compile(r"^\| (.+?) \|.*$", re.MULTILINE)
THEN: Final = re.compile(r"^on (\S+)\n\((.*)\)\.$", re.MULTILINE)
APART: Final = re.compile(r"^- Apart from the others, on .*\n", re.MULTILINE)
MISSED: Final = re.compile(r"^- \*\*(.+?)\*\* in .*$", re.MULTILINE)
HEAD: Final = (
    "| fault | must | limit | lockstep: known, stopped | path "
    "| wall: known, stopped | path | log |\n"
    "|---|---|---|---|---|---|---|---|"
)

NOT_DONE: Final = {Way.LOCKSTEP: "needs processes", Way.WALL: "needs simulated time"}


def page(results: Results, machine: Mapping[str, object], before: str = "") -> str:
    """Return the page in Markdown; faults not measured now keep their rows of the old page.

    The page then keeps the date and machine of the old page, and lists the misses of old rows too.
    """
    old = rows_in(before)
    about = ", ".join(f"{key} {value}" for key, value in machine.items())
    date = f"{datetime.now(UTC):%Y-%m-%d}"
    kept = [one.name for one in FAULTS if one.name in old and not measured(one, results)]
    then = THEN.search(before) if kept else None
    if then is None:
        parts = [INTRODUCTION.format(date=date, machine=about)]
    else:
        parts = [INTRODUCTION.format(date=then[1], machine=then[2])]
        now = ", ".join(one.name for one in FAULTS if measured(one, results))
        parts += [*APART.findall(before), f"- Apart from the others, on {date} ({about}): {now}.\n"]
    parts += missed(results, [one[0] for one in MISSED.finditer(before) if one[1] in kept])
    for title, faults in GROUPS.items():
        parts += [f"## {title}\n", HEAD]
        for fault in faults:
            keep = fault.name in old and not measured(fault, results)
            parts.append(old[fault.name] if keep else row(fault, results))
        parts.append("")
    return "\n".join(parts)


def rows_in(text: str) -> dict[str, str]:
    """Return the rows of a page by the name of their fault."""
    return {found[1].replace("\\|", "|"): found[0] for found in ROW.finditer(text)}


def measured(fault: FaultCase, results: Results) -> bool:
    """Return whether there are results for a fault."""
    return any(results.of(fault, way) for way in fault.ways)


def missed(results: Results, before: Sequence[str] = ()) -> Iterable[str]:
    """Yield the rows that miss a limit, by name and with all misses."""
    yield "## Rows that miss their limit\n"
    found = [*before]
    for faults in GROUPS.values():
        for fault in faults:
            for way in fault.ways:
                repetitions = results.of(fault, way)
                bad = [(one.number, miss) for one in repetitions for miss in one.misses(fault)]
                if bad:
                    times = len({number for number, _ in bad})
                    words = "; ".join(sorted({miss for _, miss in bad}))
                    found.append(
                        f"- **{fault.name}** in {way.value}, {times} of {len(repetitions)}: {words}"
                    )
    yield from found or ["None."]
    yield ""


def row(fault: FaultCase, results: Results) -> str:
    """Return the row of a fault."""
    cells = [fault.name, fault.must.value, fault.limit or ""]
    for way in Way:
        found = results.of(fault, way)
        cells += [times(fault, found, way), way_cm(found)]
    cells.append(log(results.of(fault, Way.WALL)))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def times(fault: FaultCase, found: Sequence[Repetition], way: Way) -> str:
    """Return median and worst times; for a robot that drives on, how often it arrived."""
    if not found:
        return "" if way in fault.ways else NOT_DONE[way]
    bad = sum(bool(one.misses(fault)) for one in found)
    verdict = f" **{bad} of {len(found)} missed**" if bad else f" ({len(found)})"
    if fault.must_stop:
        known = spread(one.known_s for one in found) if fault.within_s is not None else "–"
        return f"{known}, {spread(one.stood_s for one in found)}{verdict}"
    if fault.must is Must.KEEP:
        return f"{sum(one.reached for one in found)} kept all" + verdict
    arrived = sum(one.reached for one in found)
    reasons = sorted({one.reason for one in found if one.reason and not one.reached})
    words = f"{arrived} arrived" + (f", else {', '.join(reasons)}" if reasons else "")
    if fault.must is Must.KEEP_TIME:
        words += f", {sum(one.missed_ticks or 0 for one in found)} ticks missed"
    touched = sum(one.contacts > 0 for one in found)
    return words + (f", {touched} touched" if touched else "") + verdict


def spread(values_s: Iterable[float | None]) -> str:
    """Return median and worst in ms."""
    found = [value for value in values_s if value is not None]
    return f"{median(found) * 1e3:.0f} / {max(found) * 1e3:.0f}" if found else "–"


def way_cm(found: Sequence[Repetition]) -> str:
    """Return the longest path in cm."""
    ways = [one.distance_m for one in found if one.distance_m is not None]
    return f"{max(ways) * 100:.1f} cm" if ways else ""


def log(found: Sequence[Repetition]) -> str:
    """Return the log's losses of the worst repetition, and what a killed recorder had not saved."""
    known = [one for one in found if one.lost is not None]
    if not known:
        return ""
    worst = max(known, key=lambda one: one.lost or 0)
    events = max(one.lost_events or 0 for one in known)
    text = f"{worst.lost} of {(worst.logged or 0) + (worst.lost or 0)}, {events} events"
    unlogged_s = [one.unlogged_s for one in known if one.unlogged_s is not None]
    return text + (f"; the last {max(unlogged_s):.2f} s" if unlogged_s else "")
