"""From tasks to results: what is done is on the disk every few seconds, whatever happens next."""

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
"""What a study waits longer for each second it has run: hours make no thousands of files."""


class Collector:
    """Rows on their way to the disk. `close` writes what is left."""

    def __init__(self, directory: Path, monotonic_s: Callable[[], float]) -> None:
        self._directory = directory
        self._monotonic_s = monotonic_s
        self._rows: list[TrialRow] = []
        self._began_s = self._written_s = monotonic_s()

    def add(self, row: TrialRow) -> None:
        self._rows.append(row)

    def look(self) -> None:
        """Write when it is time again."""
        now_s = self._monotonic_s()
        every_s = min(FLUSH_S + FLUSH_GROWTH * (now_s - self._began_s), MAX_FLUSH_S)
        if now_s - self._written_s >= every_s:
            self.close()

    def close(self) -> None:
        """Raises UserError when it cannot be written; the rows are then given up."""
        self._written_s = self._monotonic_s()
        if not self._rows:
            return
        # After an interrupt the rows are written again; a trial counts once in the results.
        try:
            write_shard(self._directory, self._rows)
        except UserError:
            self._rows = []
            raise
        self._rows = []


def collect(rows: Iterable[TrialRow | None], collector: Collector, progress: StudyProgress) -> None:
    """Until there are no more; also when it is broken off, all that came is written."""
    try:
        for row in rows:
            if row is not None:
                collector.add(row)
                progress.add(row)
            collector.look()
            progress.show()
    finally:
        collector.close()
        progress.close()


def recover(directory: Path) -> Iterator[str]:
    """Put the directory in order after whatever happened; says what was done."""
    for left in (*directory.glob(f"*{UNFINISHED}"), *(directory / SHARDS).glob(f"*{UNFINISHED}")):
        left.unlink()
    if not files_of(directory):
        return
    for file, reason in find(directory).unreadable:
        place = set_aside(directory, file)
        yield f"{file}: cannot be read ({reason}); kept as {place}, its trials are run again"


def finished(directory: Path) -> pa.Table | None:
    """What is there already; None when nothing is."""
    return find(directory).table if files_of(directory) else None


def open_tasks(tasks: list[TrialTask], there: pa.Table | None) -> list[TrialTask]:
    """Those of which nothing is there yet."""
    if there is None:
        return tasks
    done = set(there["trial_id"].to_pylist())
    return [task for task in tasks if task.trial_id not in done]


def finish(directory: Path, provenance: Mapping[str, str]) -> Path:
    """All into one file."""
    return compact(directory, find(directory).table, provenance)
