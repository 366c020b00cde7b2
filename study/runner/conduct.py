"""Collect the rows of a study and write them to disk every few seconds."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

import pyarrow as pa

from runtime.errors import UserError
from study.runner.plan import TrialTask
from study.runner.progress import StudyProgress
from study.runner.rows import TrialRow
from study.runner.store import (
    SHARDS,
    UNFINISHED,
    compact,
    files_of,
    find,
    set_aside,
    write_shard,
)

FLUSH_S: Final = 2.0
MAX_FLUSH_S: Final = 10.0
FLUSH_GROWTH: Final = 1.0 / 60.0
"""Growth of the write interval per second of run time, so that long runs write fewer files."""


class Collector:
    """Buffer rows and write them as shards; `flush` writes the rest."""

    def __init__(self, directory: Path, monotonic_s: Callable[[], float]) -> None:
        self._directory = directory
        self._monotonic_s = monotonic_s
        self._rows: list[TrialRow] = []
        self._began_s = self._written_s = monotonic_s()

    def add(self, row: TrialRow) -> None:
        """Buffer a row."""
        self._rows.append(row)

    def flush_if_due(self) -> None:
        """Write the buffered rows if the interval has passed."""
        now_s = self._monotonic_s()
        every_s = min(FLUSH_S + FLUSH_GROWTH * (now_s - self._began_s), MAX_FLUSH_S)
        if now_s - self._written_s >= every_s:
            self.flush()

    def flush(self) -> None:
        """Write the buffered rows; on failure drop them and raise UserError."""
        self._written_s = self._monotonic_s()
        if not self._rows:
            return
        # An interrupt may write rows twice; results count a trial once.
        try:
            write_shard(self._directory, self._rows)
        except UserError:
            self._rows = []
            raise
        self._rows = []


def collect(rows: Iterable[TrialRow | None], collector: Collector, progress: StudyProgress) -> None:
    """Collect all rows; write what has arrived also when interrupted."""
    try:
        for row in rows:
            if row is not None:
                collector.add(row)
                progress.add(row)
            collector.flush_if_due()
            progress.show_if_due()
    finally:
        collector.flush()
        progress.close()


def recover(directory: Path) -> Iterator[str]:
    """Repair the directory of an interrupted study; yield what was done."""
    for left in (*directory.glob(f"*{UNFINISHED}"), *(directory / SHARDS).glob(f"*{UNFINISHED}")):
        left.unlink()
    if not files_of(directory):
        return
    for file, reason in find(directory).unreadable:
        place = set_aside(directory, file)
        yield f"{file}: cannot be read ({reason}); moved to {place}, its trials will run again"


def stored_rows(directory: Path) -> pa.Table | None:
    """Return the rows stored so far; None without any file."""
    return find(directory).table if files_of(directory) else None


def missing_tasks(tasks: list[TrialTask], stored: pa.Table | None) -> list[TrialTask]:
    """Return the tasks that have no stored row."""
    if stored is None:
        return tasks
    done = set(stored["trial_id"].to_pylist())
    return [task for task in tasks if task.trial_id not in done]


def finish(directory: Path, provenance: Mapping[str, str]) -> Path:
    """Merge all stored rows into one file with this provenance."""
    return compact(directory, find(directory).table, provenance)
