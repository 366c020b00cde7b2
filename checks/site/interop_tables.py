"""Write the results of `make interop` into the documentation: clients, and rows of the judge.

`python -m checks.site.interop_tables clients` writes the results of real clients to their page.
With `rows` it writes the verdicts of the judge: the JSON output of `sidestep mavlink check` for
each line is in `docs/evidence/mavlink`, and new results replace it. The titles of the rows are the
judge's.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from shutil import copyfile
from statistics import median
from typing import Any, Final, NamedTuple

from checks.site.reference import table
from study.report.page import with_text
from vehicle_check.judge import rows
from vehicle_check.vehicle_under_test import RowStatus

ROOT: Final = Path(__file__).resolve().parents[2]
RESULTS: Final = ROOT / "build" / "interop" / "results.jsonl"
PAGE: Final = ROOT / "docs" / "how-to" / "other-ground-stations.md"
BEGIN: Final = "<!-- begin: make clients-table -->\n"
END: Final = "<!-- end: make clients-table -->\n"
LINES: Final = {"clean": "clean", "poor": "20 % loss", "tcp": "TCP"}
READY: Final = ("connect", "parameters", "home")
"""The steps until a client is ready."""
READY_HEAD: Final = "ready: median (longest)"
NAMES: Final = {
    "mavutil": "pymavlink 2.4.50",
    "mavproxy": "MAVProxy 1.8.75",
    "mavsdk": "MAVSDK 4.1.0",
    "dronekit": "DroneKit 2.9.2",
    "dronekit2": "dronekit2 3.0.0",
    "mavkit": "MavKit 0.3.0",
    "node_mavlink": "node-mavlink 2.3.0",
    "configurator": "Methodic Configurator 5.0.1",
    "qgroundcontrol": "QGroundControl (script)",
    "mission_planner": "Mission Planner (script)",
    "mavros": "mavros (script)",
}
WORDS: Final = {
    "connect": "connect",
    "parameters": "read all parameters",
    "home": "learn the home position",
    "set_parameter": "set a parameter",
    "fence": "upload a fence",
    "log": "download a recording",
    "upload": "upload a mission",
    "start": "arm and start it",
    "pause": "pause it",
    "complete": "complete it",
    "goto": "drive to a point",
    "mode": "change the mode",
    "stop": "stop in an emergency",
}


class ClientRun(NamedTuple):
    """A run of a scenario: the seconds of each step of the client, None for one that failed."""

    client: str
    line: str
    steps: Mapping[str, float | None]

    @property
    def is_complete(self) -> bool:
        """Whether all steps have passed."""
        return None not in self.steps.values()

    @property
    def ready_s(self) -> float | None:
        """Seconds from the first frame until the client is ready; None if it was never ready."""
        times = [self.steps[step] for step in READY if step in self.steps]
        known = [one for one in times if one is not None]
        return sum(known) if len(known) == len(times) else None


def write_clients(argv: Sequence[str] | None = None) -> int:
    """Rewrite the tables; return 1 without results."""
    parser = argparse.ArgumentParser(prog="make clients-table", description=__doc__)
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--page", type=Path, default=PAGE)
    options = parser.parse_args(argv)
    if not options.results.exists():
        print(f"{options.results}: no results; run `make interop` first", file=sys.stderr)
        return 1
    runs = [run_of(line) for line in options.results.read_text(encoding="utf-8").splitlines()]
    text = options.page.read_text(encoding="utf-8")
    options.page.write_text(with_tables(text, runs), encoding="utf-8")
    print(f"{options.page}: {len(runs)} runs", file=sys.stderr)
    return 0


def run_of(line: str) -> ClientRun:
    """Return the run in a line of the results."""
    found = json.loads(line)
    steps = {one["step"]: one["seconds"] if one["passed"] else None for one in found["steps"]}
    return ClientRun(found["client"], found["line"], steps)


def with_tables(page: str, runs: Sequence[ClientRun]) -> str:
    """Return the page with new tables between its marks."""
    return with_text(page, BEGIN, END, f"\n{summary(runs)}\n{by_step(runs)}\n")


def summary(runs: Sequence[ClientRun]) -> str:
    """Return the table of clients: complete runs, and the time until the clients were ready."""
    rows = []
    for client, name in NAMES.items():
        cells = [name]
        for line in LINES:
            here = [run for run in runs if (run.client, run.line) == (client, line)]
            passed = sum(run.is_complete for run in here)
            ready = [run.ready_s for run in here if run.ready_s is not None]
            cells.append(f"{passed} of {len(here)}" if here else "not run")
            cells.append(f"{median(ready):.1f} s ({max(ready):.1f} s)" if ready else "")
        rows.append(cells)
    heads = ["client"]
    for words in LINES.values():
        heads += [f"{words}: passed", READY_HEAD]
    return table(heads, rows) + "\n"


def by_step(runs: Sequence[ClientRun]) -> str:
    """Return the table of steps: the median time with each client, clean and with loss."""
    rows = []
    for step, words in WORDS.items():
        cells = [words]
        for client in NAMES:
            times = [
                seconds_of([run for run in runs if (run.client, run.line) == (client, line)], step)
                for line in LINES
            ]
            cells.append(" / ".join(times))
        rows.append(cells)
    return table([f"seconds, {' / '.join(LINES.values())}", *NAMES.values()], rows) + "\n"


def seconds_of(runs: Sequence[ClientRun], step: str) -> str:
    """Return the median time of a step; a dash if no client did it, and `failed` if one failed."""
    times = [run.steps[step] for run in runs if step in run.steps]
    known = [one for one in times if one is not None]
    if not times:
        return "–"
    return f"{median(known):.1f}" if len(known) == len(times) else "failed"


ROWS_RESULTS: Final = ROOT / "build" / "interop" / "rows"
EVIDENCE: Final = ROOT / "docs" / "evidence" / "mavlink"
ROWS_PAGE: Final = ROOT / "docs" / "reference" / "mavlink-rows.md"
ROWS_BEGIN: Final = "<!-- begin: make rows-table -->\n"
ROWS_END: Final = "<!-- end: make rows-table -->\n"
VEHICLES: Final = {
    "ardupilot-like": "does as ArduPilot's Rover, without sonars and operator control",
    "hasty": "has the defects behind most of the rows from 61 on",
    "careless": "answers everybody, skips sequence numbers, ignores targets",
    "mute": "sends a heartbeat, and answers nothing",
}
"""Reports of vehicles in simulated time: `python -m tests.support.vehicle_check.reports`."""
ROWS_LINES: Final = {"udp": "UDP", "loss": "UDP, 20 % loss", "tcp": "TCP"}


class RowResult(NamedTuple):
    """The status of a row, and its evidence."""

    status: str
    evidence: str


Results = Mapping[int, RowResult]
"""The results of one line, by the number of the row."""


def write_rows(argv: Sequence[str] | None = None) -> int:
    """Take over new results and rewrite the table; return 1 without results."""
    parser = argparse.ArgumentParser(prog="make rows-table", description=__doc__)
    parser.add_argument("--results", type=Path, default=ROWS_RESULTS)
    parser.add_argument("--evidence", type=Path, default=EVIDENCE)
    parser.add_argument("--page", type=Path, default=ROWS_PAGE)
    options = parser.parse_args(argv)
    options.evidence.mkdir(parents=True, exist_ok=True)
    for line in ROWS_LINES:
        if (options.results / f"{line}.json").exists():
            copyfile(options.results / f"{line}.json", options.evidence / f"{line}.json")
    found = results_in(options.evidence)
    others = {name: results_of(EVIDENCE / f"{name}.json") for name in VEHICLES}
    if not any(found.values()):
        print(f"{options.evidence}: no results; run `make interop` first", file=sys.stderr)
        return 1
    page = options.page.read_text(encoding="utf-8")
    options.page.write_text(with_table(page, found, others), encoding="utf-8")
    return 0


def results_in(folder: Path) -> dict[str, Results]:
    """Return the results of each line; none for a line without a file."""
    return {line: results_of(folder / f"{line}.json") for line in ROWS_LINES}


def results_of(path: Path) -> Results:
    """Return the results in the JSON output of the judge."""
    if not path.exists():
        return {}
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return {one["row"]: RowResult(one["status"], one["evidence"]) for one in found["rows"]}


def with_table(page: str, found: Mapping[str, Results], others: Mapping[str, Results]) -> str:
    """Return the page with new tables between its marks."""
    tables = f"{rows_summary(found)}\n\n{row_table(found)}\n\n{exceptions(found)}"
    tables += f"## Other vehicles\n\n{vehicle_table(others)}\n\n"
    return with_text(page, ROWS_BEGIN, ROWS_END, f"\n{tables}")


def rows_summary(found: Mapping[str, Results]) -> str:
    """Return how many rows passed on each line."""
    lines = []
    for line, name in ROWS_LINES.items():
        passed = sum(one.status == RowStatus.PASS for one in found[line].values())
        lines.append([name, f"{passed} of {len(rows())}" if found[line] else "not run"])
    return table(["line", "rows passed"], lines)


def row_table(found: Mapping[str, Results]) -> str:
    """Return the table of rows: title, clients, and the result on each line."""
    lines = []
    for number, row in sorted(rows().items()):
        results = [found[line].get(number) for line in ROWS_LINES]
        cells = ["–" if one is None else one.status for one in results]
        lines.append([number, row.title, row.source, row.suffers, *cells])
    heads = ["row", "requirement", "source", "a failure affects", *ROWS_LINES.values()]
    return table(heads, lines)


def vehicle_table(found: Mapping[str, Results]) -> str:
    """Return the table of simulated vehicles: how many rows passed, and which failed."""
    lines = []
    for name, words in VEHICLES.items():
        passed = [row for row, one in found[name].items() if one.status == RowStatus.PASS]
        failed = [row for row, one in found[name].items() if one.status == RowStatus.FAIL]
        named = ", ".join(map(str, sorted(failed))) or "none"
        lines.append([name, words, len(passed), named if len(failed) < MANY else len(failed)])
    return table(["vehicle", "what it does", "rows passed", "rows failed"], lines)


MANY: Final = 30
"""So many rows are counted, not named."""


def exceptions(found: Mapping[str, Results]) -> str:
    """Return the reason of each result that is no pass."""
    lines = [
        f"- Row {number}, {ROWS_LINES[line]}: {one.status}. {one.evidence}\n"
        for line, results in found.items()
        for number, one in sorted(results.items())
        if one.status != RowStatus.PASS
    ]
    return "".join([*lines, "\n"]) if lines else ""


if __name__ == "__main__":
    which = {"clients": write_clients, "rows": write_rows}[sys.argv[1]]
    sys.exit(which(sys.argv[2:]))
