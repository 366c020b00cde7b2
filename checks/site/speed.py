"""`make speed`: measure ratios, print what has moved since the last committed ones, keep a history.

Each benchmark of `MEASURED` compares ours with something else in the same run: with ir-sim, a bare
ping-pong, pymavlink, textual-plotext, and with an older commit, which is unpacked from the history
(`--against COMMIT`). The work of the hot paths is counted (checks/speed/counts.py). A figure has
moved when its spread does not meet the last committed one; one without a spread, by over 1 %.

`--record` appends a row for this commit to the history: to the data in docs/evidence/speed.json,
and to the tables and the plot on the page of figures. `--sections` also renews the sections of
these benchmarks there. Neither works with uncommitted changes.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, Final

import msgspec

from checks.evidence import FIGURES, FOLDER, ROOT, CommitHistory
from checks.harness.figures import describe_machine, digits, machine_load
from checks.site.figures_page import measured, section, with_section
from checks.speed import counts
from checks.speed.against import BASELINE, missing
from runtime.errors import EXIT_USAGE
from study.report.charts import SvgDrawing
from study.report.page import with_text

AGAINST: Final = "against"
MEASURED: Final[Mapping[str, tuple[str, ...]]] = {
    "trial": (),
    AGAINST: (),
    "codec": (),
    "latency": (),
    "lockstep": ("--worlds", "forest_medium", "--repetitions", "3"),
    "map": (),
}
"""Benchmarks with ratios, and their options."""

PAGE: Final = ROOT / FOLDER / "figures.md"
DATA: Final = ROOT / FOLDER / "speed.json"
PLOT: Final = ROOT / FOLDER / "speed.svg"
BEGIN: Final = "<!-- begin: python -m checks.site.speed -->\n"
END: Final = "<!-- end: python -m checks.site.speed -->\n"
NOISE: Final = 0.01
"""Least share of change that is reported of a figure without a spread."""

RATIOS: Final = {
    "trial / ir-sim": "trial: forest_dense, ours / ir-sim",
    "trial `vgm` / before": "against: trial, vgm: now / before",
    "trial `vgm_memory` / before": "against: trial, vgm_memory: now / before",
    "instructions `vgm` / before": "against: instructions, vgm: now / before",
    "instructions `vgm_memory` / before": "against: instructions, vgm_memory: now / before",
    "trial pure / compiled": "against: trial, vgm_memory: pure / compiled",
    "robot CPU / before": "against: robot at 20 Hz, CPU: now / before",
    "robot memory / before": "against: robot at 20 Hz, memory: now / before",
    "latency p50 / floor": "latency: ours / floor, p50",
    "latency p99 / floor": "latency: ours / floor, p99",
    "lockstep tick / floor": "lockstep: forest_medium, tick / (trial's tick + round trip)",
    "pymavlink / codec": "codec: pymavlink / ours, encode + decode",
    "map / textual-plotext": "map: ours / textual-plotext",
}
"""The columns of the history, and the figures in them."""

COUNTED: Final = ("core step, vgm", "core step, vgm_memory", "trial", "robot cycle", "plant tick")
CODEC: Final = "codec, encode and decode"


class FigureSpread(msgspec.Struct, frozen=True):
    """The median, minimum and maximum of a figure."""

    median: float
    minimum: float
    maximum: float

    def text(self) -> str:
        """Return the figure for a person."""
        if self.minimum == self.maximum:
            return digits(self.median)
        return f"{digits(self.median)} ({digits(self.minimum)} to {digits(self.maximum)})"

    def differs(self, other: "FigureSpread") -> bool:
        """Return whether the two differ by more than noise."""
        apart = self.minimum > other.maximum or self.maximum < other.minimum
        return apart and abs(self.median - other.median) > NOISE * abs(other.median)


class SpeedRow(msgspec.Struct, frozen=True):
    """What was measured of a commit; `before` is the commit that it was compared with."""

    date: str
    commit: str
    before: str
    machine: dict[str, Any]
    figures: dict[str, FigureSpread]
    work: dict[str, float]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, compare and record; return 1 if a benchmark failed, 2 for wrong usage."""
    parser = argparse.ArgumentParser(prog="make speed", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(MEASURED)}")
    parser.add_argument("--against", default=BASELINE, metavar="COMMIT")
    parser.add_argument("--record", action="store_true", help="append a row to the history")
    parser.add_argument("--sections", action="store_true", help="renew sections of the page")
    options = parser.parse_args(argv)
    if unknown := [name for name in options.names if name not in MEASURED]:
        parser.error(f"{unknown[0]}: no benchmark with ratios; these are {', '.join(MEASURED)}")
    history = CommitHistory(ROOT)
    commit = "" if history.missing == "no git history" else history.head()
    if options.record or options.sections:
        changes = history.changes_since(commit) if commit else ["no git history"]
        if changes:
            print(f"speed: commit first, the row names a commit: {changes[0]}", file=sys.stderr)
            return EXIT_USAGE
    load = machine_load()
    reports = dict(reported(options.names or list(MEASURED), options.against))
    failed = [name for name, report in reports.items() if report is None]
    found = {name: report for name, report in reports.items() if report is not None}
    machine = describe_machine(load)
    row = row_of(commit, options.against, machine, found, counted())
    rows = read()
    print(*comparison(row, rows[-1] if rows else None), sep="\n")
    if options.sections:
        write_sections(found, options.against)
    if options.record:
        write(with_row(rows, row))
    for report in found.values():
        for note in report["notes"]:
            print(f"  note: {note}")
    for name in failed:
        print(f"speed: {name} could not be measured", file=sys.stderr)
    return 1 if failed else 0


def reported(names: Iterable[str], against: str) -> Iterator[tuple[str, dict[str, Any] | None]]:
    """Measure and yield each benchmark with its report, None if it failed."""
    for name in names:
        if name == AGAINST and (problem := missing(against, ROOT)):
            print(f"speed: no comparison with an older commit: {problem}", file=sys.stderr)
            continue
        print(f"{name} ...", file=sys.stderr, flush=True)
        yield name, measured((name, *options_of(name, against)))


def options_of(name: str, against: str) -> tuple[str, ...]:
    """Return the options of a benchmark."""
    return ("--against", against) if name == AGAINST else MEASURED[name]


def counted() -> dict[str, float]:
    """Count and return the work of the paths in the history."""
    totals = {path.name: path.work.total for path in counts.counted_paths()}
    codec = sum(work for name, work in totals.items() if name.startswith(("encode ", "decode ")))
    return {name: round(totals[name], 1) for name in COUNTED} | {CODEC: round(codec, 1)}


def row_of(
    commit: str,
    before: str,
    machine: dict[str, Any],
    reports: Mapping[str, Mapping[str, Any]],
    work: dict[str, float],
) -> SpeedRow:
    """Return the row of a measurement."""
    figures = {
        f"{name}: {figure['name']}": FigureSpread(
            *(float(f"{figure[one]:.4g}") for one in ("median", "minimum", "maximum"))
        )
        for name, report in reports.items()
        for figure in report["figures"]
    }
    ratios = {name: figures[name] for name in RATIOS.values() if name in figures}
    return SpeedRow(f"{datetime.now(UTC):%Y-%m-%d}", commit, before, machine, ratios, work)


def comparison(row: SpeedRow, last: SpeedRow | None) -> Iterator[str]:
    """Yield each ratio and count, and what has moved since the last row."""
    if last is None:
        yield "nothing was committed to compare with"
    else:
        yield f"compared with commit {last.commit} of {last.date}, {described(last.machine)}"
    moved = 0
    for title, name in RATIOS.items():
        if name not in row.figures:
            continue
        now, was = row.figures[name], None if last is None else last.figures.get(name)
        if last is not None and name.startswith(AGAINST) and row.before != last.before:
            was = None
        has_moved = was is not None and now.differs(was)
        moved += has_moved
        shown = None if was is None else was.text()
        yield line(title.replace("`", ""), now.text(), shown, has_moved)
    for name, work in row.work.items():
        before = None if last is None else last.work.get(name)
        has_moved = before is not None and abs(work - before) > NOISE * before
        moved += has_moved
        shown = None if before is None else f"{before:.0f}"
        yield line(f"counted work, {name}", f"{work:.0f}", shown, has_moved)
    if last is not None:
        yield f"{moved} moved beyond noise" if moved else "nothing moved beyond noise"


def with_row(rows: Sequence[SpeedRow], row: SpeedRow) -> list[SpeedRow]:
    """Return the history with a row; one of the same commit keeps what was not measured again."""
    others = [one for one in rows if one.commit != row.commit]
    for one in rows:
        if one.commit == row.commit and one.before == row.before:
            machine = row.machine if row.figures else one.machine
            figures = one.figures | row.figures
            row = msgspec.structs.replace(row, machine=machine, figures=figures)
    return [*others, row]


def line(title: str, now: str, was: str | None, has_moved: bool) -> str:
    """Return the line of a figure."""
    mark = "MOVED" if has_moved else ""
    since = "" if was is None else f"was {was}"
    return f"  {title:<38} {now:<28} {since:<32} {mark}".rstrip()


def described(machine: Mapping[str, Any]) -> str:
    """Return a machine in words."""
    return ", ".join(f"{name} {value}" for name, value in machine.items())


def read() -> list[SpeedRow]:
    """Return the history, the oldest row first."""
    return msgspec.json.decode(DATA.read_bytes(), type=list[SpeedRow]) if DATA.exists() else []


def write(rows: Sequence[SpeedRow]) -> None:
    """Write the data, the plot and the section of the page."""
    DATA.write_bytes(msgspec.json.format(msgspec.json.encode(rows), indent=1) + b"\n")
    PLOT.write_text(plot(rows).alone(), encoding="utf-8")
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(with_text(text, BEGIN, END, f"\n{tables(rows)}\n\n"), encoding="utf-8")


def write_sections(reports: Mapping[str, Mapping[str, Any]], against: str) -> None:
    """Renew the sections of the benchmarks that the page has."""
    text = PAGE.read_text(encoding="utf-8")
    for name, report in reports.items():
        if name in FIGURES:
            arguments = (name, *options_of(name, against))
            text = with_section(text, name, section(arguments, report))
    PAGE.write_text(text, encoding="utf-8")


def tables(rows: Sequence[SpeedRow]) -> str:
    """Return the tables of the history, a row for each measured commit, and the plot."""
    head = ("date", "commit", "before", "machine")
    names = [
        (row.date, f"`{row.commit}`", f"`{row.before}`", described(row.machine)) for row in rows
    ]
    measured_cells = [
        [row.figures[name].text() if name in row.figures else "-" for name in RATIOS.values()]
        for row in rows
    ]
    work = list(dict.fromkeys(name for row in rows for name in row.work))
    counted_cells = [
        [f"{row.work[name]:.0f}" if name in row.work else "-" for name in work] for row in rows
    ]
    return "\n\n".join(
        (
            table((*head, *RATIOS), zip(names, measured_cells, strict=True)),
            f"![Cost of a trial, compared with an older commit]({PLOT.name})",
            "The counted work is that of a tick; of the codec, of all messages of a tick.",
            table(
                ("commit", *work), zip([name[1:2] for name in names], counted_cells, strict=True)
            ),
        )
    )


def table(head: Sequence[str], rows: Iterable[tuple[Sequence[str], Sequence[str]]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---"] * len(head), *((*names, *cells) for names, cells in rows)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


WIDE, HIGH, LEFT, TOP = 480.0, 160.0, 44.0, 34.0
LINES: Final = {name: f"against: trial, {name}: now / before" for name in ("vgm", "vgm_memory")}


def plot(rows: Sequence[SpeedRow]) -> SvgDrawing:
    """Draw the cost of a trial in each row that has the usual commit to compare with."""
    rows = [row for row in rows if row.before == BASELINE]
    title = "Cost of a trial, compared with an older commit"
    drawing = SvgDrawing(LEFT + WIDE + 20.0, TOP + HIGH + 30.0, title)
    spreads = [row.figures[name] for row in rows for name in LINES.values() if name in row.figures]
    most = max([1.2, *(spread.maximum for spread in spreads)])

    def place(index: int, ratio: float) -> tuple[float, float]:
        return LEFT + WIDE * (index + 0.5) / len(rows), TOP + HIGH * (1.0 - ratio / most)

    for ratio in (0.0, 0.5, 1.0):
        _, y = place(0, ratio)
        drawing.line((LEFT, y), (LEFT + WIDE, y), "grid")
        drawing.text((LEFT - 6.0, y + 3.5), f"{ratio:g}", "small", "end")
    for index, row in enumerate(rows):
        drawing.text((place(index, 0.0)[0], TOP + HIGH + 16.0), row.commit, "small", "middle")
    for number, (label, name) in enumerate(LINES.items()):
        x = LEFT + 100.0 * number
        drawing.line((x, 10.0), (x + 20.0, 10.0), f"way l-{label}")
        drawing.text((x + 25.0, 14.0), label, "small")
        found = [(at, row.figures[name]) for at, row in enumerate(rows) if name in row.figures]
        drawing.polyline([place(at, spread.median) for at, spread in found], f"way l-{label}")
        for at, spread in found:
            ends = place(at, spread.minimum), place(at, spread.maximum)
            drawing.line(*ends, f"whisker l-{label}")
            drawing.circle(place(at, spread.median), 3.5, f"mark f-{label}")
    return drawing


if __name__ == "__main__":
    sys.exit(main())
