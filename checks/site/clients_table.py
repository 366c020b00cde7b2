"""`python -m checks.site.clients_table`: write results of real clients to the page.

It reads the results of `make interop` and rewrites the tables of the page.
"""

import argparse
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

from study.report.page import with_text

ROOT: Final = Path(__file__).resolve().parents[2]
RESULTS: Final = ROOT / "build" / "interop" / "results.jsonl"
PAGE: Final = ROOT / "docs" / "how-to" / "other-ground-stations.md"
BEGIN: Final = "<!-- begin: make clients-table -->\n"
END: Final = "<!-- end: make clients-table -->\n"
LINES: Final = {"clean": "clean", "poor": "20 % loss"}
READY: Final = ("connect", "parameters", "home")
"""The steps until a client is ready."""
READY_HEAD: Final = "ready: median (longest)"
NAMES: Final = {
    "mavutil": "pymavlink 2.4.50",
    "mavproxy": "MAVProxy 1.8.75",
    "mavsdk": "MAVSDK 4.1.0",
    "dronekit": "DroneKit 2.9.2",
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
    """A run of a scenario: the seconds of each step, None for one that failed."""

    client: str
    line: str
    steps: Mapping[str, float | None]

    @property
    def is_complete(self) -> bool:
        """Whether all steps have passed."""
        return all(self.steps.get(step) is not None for step in WORDS)

    @property
    def ready_s(self) -> float | None:
        """Seconds from the first frame until the client is ready; None if it was never ready."""
        times = [self.steps.get(step) for step in READY]
        known = [one for one in times if one is not None]
        return sum(known) if len(known) == len(READY) else None


def main(argv: Sequence[str] | None = None) -> int:
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
    heads = ["client", "clean: passed", READY_HEAD, "20 % loss: passed", READY_HEAD]
    return table(heads, rows)


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
    return table(["seconds, clean / 20 % loss", *NAMES.values()], rows)


def seconds_of(runs: Sequence[ClientRun], step: str) -> str:
    """Return the median time of a step; a dash without runs, and `failed` if one failed."""
    times = [run.steps.get(step) for run in runs]
    known = [one for one in times if one is not None]
    if not runs:
        return "–"
    return f"{median(known):.1f}" if len(known) == len(times) else "failed"


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


if __name__ == "__main__":
    sys.exit(main())
