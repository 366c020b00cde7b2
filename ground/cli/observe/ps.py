"""`ps`: list the runs of `up` on this machine."""

import argparse
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

from ground.commands.command import add_json
from ground.text.output import Output
from ground.user.runs import FoundRun, age_text, read_runs

NOTHING: Final = "nothing runs here. Start it: sidestep up"
HEADS: Final = ("NAME", "SINCE", "ROBOTS", "WORLD", "ENDPOINT", "PROCESSES")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `ps`."""
    add_json(parser)


def run(options: argparse.Namespace, output: Output) -> int:
    """Print one line per run; return 0."""
    runs = read_runs()
    for file, why in runs.ignored:
        output.note(f"{file}: {why}; ignored, remove it")
    row: dict[str, object] = {
        "verb": "ps",
        "ok": True,
        "runs": [as_json(one) for one in runs.found],
        "ignored": [{"file": str(file), "reason": why} for file, why in runs.ignored],
    }
    output.result(row, "\n".join(table(runs.found)) if runs.found else NOTHING)
    return 0


def as_json(found: FoundRun) -> dict[str, object]:
    """Return a run as a row."""
    run = found.run
    return {
        "name": found.name,
        "since": run.since.isoformat(timespec="seconds"),
        "endpoint": run.endpoint,
        "robots": run.robots,
        "world": run.world,
        "pid": run.pid,
        "processes": run.processes,
        "locks": run.locks,
        "record": run.record,
        "recordings": run.recordings,
    }


def table(found: Sequence[FoundRun]) -> list[str]:
    """Return a head and one line per run, in columns."""
    now = datetime.now(UTC)
    rows = [HEADS, *(cells(one, now) for one in found)]
    *widths, _ = (max(map(len, column)) for column in zip(*rows, strict=True))
    return [
        "  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[-1]])
        for row in rows
    ]


def cells(found: FoundRun, now: datetime) -> tuple[str, ...]:
    """Return the cells of a run: its process ids are last, as they are the longest."""
    run = found.run
    since = f"{run.since.astimezone():%H:%M:%S %Z} ({age_text(run.since, now)})"
    processes = [("up", run.pid), *run.processes.items()]
    return (
        found.name,
        since,
        " ".join(run.robots),
        run.world,
        run.endpoint,
        ", ".join(f"{role} {pid}" for role, pid in processes),
    )
