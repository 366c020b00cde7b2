"""`rec list`: the recordings of a folder, each with what it holds."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any, Final, Self

from ground.client.outcomes import Progress, Report
from ground.commands.command import FileCommand, command, parsed, place
from ground.recording.catalogue import (
    FILE_HELP,
    recording_named,
    recordings_in,
    remark_on,
    size_text,
)
from ground.recording.summary import Summary, summary_of
from ground.user.folders import recordings_folder
from runtime.cli.verb import REC

SUFFIXES: Final = (".tlog", ".mcap")
HEADS: Final = ("", "BEGAN", "LENGTH", "WORLD", "NAVIGATOR", "LAST GOAL", "SIZE", "NAME")
UNKNOWN: Final = "--"
RUNNING: Final = "REC"
"""Mark of a recording that is not finished. It has no number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingCommand(FileCommand):
    """A command on a recording; on the command line by default the newest finished one.

    `remark` is what is said about the choice first.
    """

    file: str = place("FILE", FILE_HELP, optional=True)
    remark: str = field(default="", compare=False)

    @classmethod
    def parsed(cls, found: Any) -> Self:
        """Return the command for the recording that was named; UserError if there is none."""
        path = recording_named(found.file)
        return parsed(cls, found, file=str(path), remark=remark_on(path, found.file))


@command(REC, 20, "rec list --json", word="recordings")
class ListRecordings(FileCommand):
    """List the recordings, the newest first."""

    folder: str | None = place(
        "DIR", lambda: f"their folder (default {recordings_folder()})", default=None
    )

    def run(self, progress: Progress) -> Report:
        """List them without a robot."""
        folder = recordings_folder() if self.folder is None else Path(self.folder)
        found = [summary_of(path) for path in recordings_in(folder)]
        row: dict[str, object] = {
            "ok": True,
            "folder": str(folder),
            "recordings": [as_json(one) for one in found],
        }
        none = f"{folder}: there is no recording; `sidestep up` makes one"
        return Report(True, "\n".join(table(found)) if found else none, row)


def as_json(one: Summary) -> dict[str, object]:
    """Return a recording as a row."""
    return {
        "file": str(one.path),
        "began": one.began.isoformat(timespec="seconds"),
        "robot": one.robot,
        "length_s": one.length_s,
        "world": one.world or None,
        "navigator": one.navigator or None,
        "outcome": one.outcome or None,
        "bytes": one.size,
        "running": one.is_running,
    }


def table(found: Sequence[Summary]) -> list[str]:
    """Return a head and a line per recording; -1 is the newest that is finished."""
    numbers = count(1)
    names = [RUNNING if one.is_running else f"-{next(numbers)}" for one in found]
    rows = [HEADS, *(cells(name, one) for name, one in zip(names, found, strict=True))]
    *widths, _ = (max(map(len, column)) for column in zip(*rows, strict=True))
    return [
        "  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[-1]])
        for row in rows
    ]


def cells(name: str, one: Summary) -> tuple[str, ...]:
    """Return the cells of a recording; `name` is its name for verbs, or a mark if it is running."""
    return (
        name,
        f"{one.began.astimezone():%Y-%m-%d %H:%M:%S %Z}",
        UNKNOWN if one.length_s is None else f"{one.length_s:.1f} s",
        one.world or UNKNOWN,
        one.navigator or UNKNOWN,
        one.outcome or UNKNOWN,
        size_text(one.size),
        one.path.name,
    )
