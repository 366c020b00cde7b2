"""`python -m benchmarks.lockstep.page --before FILE... --after FILE...`: compare two versions.

The files are outputs of `sidestep bench NAME --json`, for one or several benchmarks. This writes
the tables of docs/evidence/lockstep.md: medians over all repetitions in the files.
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, Final

from study.report.output.marks import with_text
from verification.harness.figures import digits

PAGE: Final = Path("docs/evidence/lockstep.md")
BEGIN: Final = "<!-- begin: benchmarks.lockstep.page -->\n"
END: Final = "<!-- end: benchmarks.lockstep.page -->\n"

Reports = dict[str, dict[str, Any]]
"""One report of each benchmark, by its name."""


def main(argv: Sequence[str] | None = None) -> int:
    """Rewrite the tables of the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.lockstep.page", description=__doc__)
    parser.add_argument("--before", type=Path, nargs="+", required=True)
    parser.add_argument("--after", type=Path, nargs="+", required=True)
    parser.add_argument("--page", type=Path, default=PAGE)
    options = parser.parse_args(argv)
    before, after = merged(options.before), merged(options.after)
    text = options.page.read_text(encoding="utf-8")
    options.page.write_text(with_tables(text, before, after), encoding="utf-8")
    return 0


def merged(files: Sequence[Path]) -> Reports:
    """Return the reports, those of one benchmark as one with the values and loads of all."""
    found: Reports = {}
    for file in files:
        report: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        first = found.setdefault(report["benchmark"], report)
        if first is report:
            continue
        for figure, other in zip(first["figures"], report["figures"], strict=True):
            figure["values"] += other["values"]
        first["machine"]["load"] += f", {report['machine']['load']}"
    return found


def with_tables(page: str, before: Reports, after: Reports) -> str:
    """Return the page with new tables between its marks."""
    tables = "\n".join(
        f"## sidestep bench {name}\n\n{table(before[name], after[name])}"
        for name in after
        if name in before
    )
    return with_text(page, BEGIN, END, f"\n{tables}\n")


def table(before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    """Return the figures of both reports side by side, with the machines."""
    former = {figure["name"]: figure for figure in before["figures"]}
    lines = ["| | before | after |", "|---|---|---|"]
    lines += [
        f"| {figure['name']} ({figure['unit']}) | {cell(former[figure['name']])} | {cell(figure)} |"
        for figure in after["figures"]
        if figure["name"] in former
    ]
    return "\n".join([*lines, "", *notes_of(before, after), ""])


def notes_of(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[str]:
    """Yield the notes of the report, and the machine of both as list items."""
    for note in after["notes"]:
        yield f"- {note}"
    for name, report in (("before", before), ("after", after)):
        machine = ", ".join(f"{key} {value}" for key, value in report["machine"].items())
        yield f"- {name}: {machine}"


def cell(figure: Mapping[str, Any]) -> str:
    """Return the median of a figure, and its range."""
    values: list[float] = figure["values"]
    return f"{digits(median(values))} ({digits(min(values))} to {digits(max(values))})"


if __name__ == "__main__":
    raise SystemExit(main())
