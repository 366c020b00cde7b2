"""docs/evidence/faults.md: the matrix, with every row that misses its limit named first."""

import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from statistics import median
from typing import Final

from verification.faults_matrix.results import Repetition, Results
from verification.faults_matrix.table import FAULTS, GROUPS, Fault, Must, Way

INTRODUCTION: Final = """\
# Faults

What the robot does when something breaks, measured by
`sidestep bench faults --page docs/evidence/faults.md`
on {date}
({machine}).
**In lockstep** time is simulated and the whole stack is in one process, over real sockets; moment,
phase of the control period and noise are drawn from the number of the repetition, so that the same
run gives the same figures. **In wall time** router, plant, robot, `goto` and recorder are real
processes on a shared machine. Where one of them is held up for long enough the robot stops for
that: BUDGET or TICKS_LOST in the place of what was to be seen is the busy machine's.

- *known*: from the fault until the robot does not drive any more and gives the reason; *stands*:
  until its wheels do not turn. Median and worst, in ms. The limit of *known* is that of the row in
  the failsafe table plus 100 ms: until the next sample would have been due, and the tick that looks
  for it. The limit of *stands* has 400 ms more, for braking from 0.3 m/s. Whatever becomes of the
  robot's own process or of its link to the plant, its wheels stand within 200 ms.
- *way*: how far it came after the fault, the worst. When it had stood the fault was ended (let go,
  mended, started again), and it had to go on standing.
- *log*: frames that were sent and that the recorder's log lacks, samples and events, the worst
  repetition. Where it was cut off from who sent, nobody had them; events come later.
- Loss, delay, copies and order are made by the bus's own fault injection (`[network.trouble]`), on
  arrival of each sample: TCP itself hides loss, and shows it as delay. A pair is cut by dropping
  whatever they publish, or, towards the router, by a cable on which nothing comes back any more.
  `tests/compose` cuts, pauses and kills real containers.
- "Router impersonated" is behind locked doors: the process in the router's place has the key of
  another robot, keeps to no rule, and sends all that could make the robot drive. The cases of a
  start are in `tests/bus/test_impostor.py`. `sidestep bench flood` attacks behind locked doors.
- A robot that hangs with the interpreter's lock held, or has been killed, is started again.
"""
ROW: Final = re.compile(r"^\| (.+?) \|.*$", re.MULTILINE)
THEN: Final = re.compile(r"^on (\S+)\n\((.*)\)\.$", re.MULTILINE)
APART: Final = re.compile(r"^- Apart from the others, on .*\n", re.MULTILINE)
MISSED: Final = re.compile(r"^- \*\*(.+?)\*\* in .*$", re.MULTILINE)
HEAD: Final = (
    "| fault | must | limit | lockstep: known, stands | way | wall: known, stands | way | log |\n"
    "|---|---|---|---|---|---|---|---|"
)

NOT_DONE: Final = {Way.LOCKSTEP: "needs processes", Way.WALL: "needs simulated time"}


def page(results: Results, machine: Mapping[str, object], before: str = "") -> str:
    """The page as Markdown. What was not measured now is taken from the page there was before.

    Such a row has its misses named, too, and the day and the machine of that page are the page's.
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


def measured(fault: Fault, results: Results) -> bool:
    return any(results.of(fault, way) for way in fault.ways)


def missed(results: Results, before: Sequence[str] = ()) -> Iterable[str]:
    """The rows that miss, by name and with what was not as it must be."""
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


def row(fault: Fault, results: Results) -> str:
    cells = [fault.name, fault.must.value, fault.limit or ""]
    for way in Way:
        found = results.of(fault, way)
        cells += [times(fault, found, way), way_cm(found)]
    cells.append(log(results.of(fault, Way.WALL)))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def times(fault: Fault, found: Sequence[Repetition], way: Way) -> str:
    """Medians and worst; for a robot that went on, how often it did."""
    if not found:
        return "" if way in fault.ways else NOT_DONE[way]
    bad = sum(bool(one.misses(fault)) for one in found)
    verdict = f" **{bad} of {len(found)} missed**" if bad else f" ({len(found)})"
    if fault.must in (Must.STOP, Must.STAND, Must.SAY):
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
    found = [value for value in values_s if value is not None]
    return f"{median(found) * 1e3:.0f} / {max(found) * 1e3:.0f}" if found else "–"


def way_cm(found: Sequence[Repetition]) -> str:
    ways = [one.distance_m for one in found if one.distance_m is not None]
    return f"{max(ways) * 100:.1f} cm" if ways else ""


def log(found: Sequence[Repetition]) -> str:
    """The worst repetition; what a killed recorder had not written yet."""
    known = [one for one in found if one.lost is not None]
    if not known:
        return ""
    worst = max(known, key=lambda one: one.lost or 0)
    events = max(one.lost_events or 0 for one in known)
    text = f"{worst.lost} of {(worst.logged or 0) + (worst.lost or 0)}, {events} events"
    unlogged_s = [one.unlogged_s for one in known if one.unlogged_s is not None]
    return text + (f"; the last {max(unlogged_s):.2f} s" if unlogged_s else "")
