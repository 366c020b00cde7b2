"""`python -m checks.site.rows_table`: the verdicts of the judge, in the documentation.

The JSON output of `sidestep mavlink check` for each line is in `docs/evidence/mavlink`. New results
of `make interop` replace it. The titles of the rows are those of the judge.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from shutil import copyfile
from typing import Any, Final, NamedTuple

from checks.site.reference import table
from study.report.page import with_text
from vehicle_check.judge import rows
from vehicle_check.vehicle_under_test import RowStatus

ROOT: Final = Path(__file__).resolve().parents[2]
RESULTS: Final = ROOT / "build" / "interop" / "rows"
EVIDENCE: Final = ROOT / "docs" / "evidence" / "mavlink"
PAGE: Final = ROOT / "docs" / "reference" / "mavlink-rows.md"
BEGIN: Final = "<!-- begin: make rows-table -->\n"
END: Final = "<!-- end: make rows-table -->\n"
LINES: Final = {"udp": "UDP", "loss": "UDP, 20 % loss", "tcp": "TCP"}


class RowResult(NamedTuple):
    """The status of a row, and its evidence."""

    status: str
    evidence: str


Results = Mapping[int, RowResult]
"""The results of one line, by the number of the row."""


def main(argv: Sequence[str] | None = None) -> int:
    """Take over new results and rewrite the table; return 1 without results."""
    parser = argparse.ArgumentParser(prog="make rows-table", description=__doc__)
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--evidence", type=Path, default=EVIDENCE)
    parser.add_argument("--page", type=Path, default=PAGE)
    options = parser.parse_args(argv)
    options.evidence.mkdir(parents=True, exist_ok=True)
    for line in LINES:
        if (options.results / f"{line}.json").exists():
            copyfile(options.results / f"{line}.json", options.evidence / f"{line}.json")
    found = results_in(options.evidence)
    if not any(found.values()):
        print(f"{options.evidence}: no results; run `make interop` first", file=sys.stderr)
        return 1
    page = options.page.read_text(encoding="utf-8")
    options.page.write_text(with_table(page, found), encoding="utf-8")
    return 0


def results_in(folder: Path) -> dict[str, Results]:
    """Return the results of each line; none for a line without a file."""
    return {line: results_of(folder / f"{line}.json") for line in LINES}


def results_of(path: Path) -> Results:
    """Return the results in the JSON output of the judge."""
    if not path.exists():
        return {}
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return {one["row"]: RowResult(one["status"], one["evidence"]) for one in found["rows"]}


def with_table(page: str, found: Mapping[str, Results]) -> str:
    """Return the page with a new table between its marks."""
    tables = f"{summary(found)}\n\n{row_table(found)}\n\n{exceptions(found)}"
    return with_text(page, BEGIN, END, f"\n{tables}")


def summary(found: Mapping[str, Results]) -> str:
    """Return how many rows passed on each line."""
    lines = []
    for line, name in LINES.items():
        passed = sum(one.status == RowStatus.PASS for one in found[line].values())
        lines.append([name, f"{passed} of {len(rows())}" if found[line] else "not run"])
    return table(["line", "rows passed"], lines)


def row_table(found: Mapping[str, Results]) -> str:
    """Return the table of rows: title, clients, and the result on each line."""
    lines = []
    for number, row in sorted(rows().items()):
        results = [found[line].get(number) for line in LINES]
        cells = ["–" if one is None else one.status for one in results]
        lines.append([number, row.title, row.suffers, *cells])
    return table(["row", "requirement", "a failure affects", *LINES.values()], lines)


def exceptions(found: Mapping[str, Results]) -> str:
    """Return the reason of each result that is no pass."""
    lines = [
        f"- Row {number}, {LINES[line]}: {one.status}. {one.evidence}\n"
        for line, results in found.items()
        for number, one in sorted(results.items())
        if one.status != RowStatus.PASS
    ]
    return "".join([*lines, "\n"]) if lines else ""


if __name__ == "__main__":
    sys.exit(main())
