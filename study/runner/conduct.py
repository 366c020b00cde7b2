"""Collect the rows of a study, write them to disk every few seconds, and show the progress."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from math import isfinite
from pathlib import Path
from typing import Final, TextIO

import pyarrow as pa

from runtime.cli.terminal import CLEAR_LINE, steer
from runtime.errors import UserError
from study.runner.plan import TrialTask
from study.runner.rows import TrialRow
from study.runner.store import SHARDS, UNFINISHED, compact, files_of, find, set_aside, write_shard

REDRAW_EVERY_S: Final = 0.5
LOG_EVERY_S: Final = 30.0


class ProgressLine(ABC):
    """Show progress in one line: overwritten on a terminal, printed at intervals elsewhere."""

    def __init__(self, file: TextIO, monotonic_s: Callable[[], float]) -> None:
        self._file = file
        self._terminal = file.isatty()
        self._every_s = REDRAW_EVERY_S if self._terminal else LOG_EVERY_S
        self._monotonic_s = monotonic_s
        self._shown_s = monotonic_s()

    @abstractmethod
    def line(self) -> str:
        """Return the progress as text."""

    def show_if_due(self) -> None:
        """Show the progress if the interval has passed."""
        if self._monotonic_s() - self._shown_s >= self._every_s:
            self._shown_s = self._monotonic_s()
            self._write(self.line())

    def close(self) -> None:
        """Show the final state and end the line."""
        self._write(self.line())
        if self._terminal:
            print(file=self._file, flush=True)

    def _write(self, line: str) -> None:
        if self._terminal:
            steer(self._file, CLEAR_LINE)
            print(line, end="", file=self._file, flush=True)
        else:
            print(line, file=self._file, flush=True)


class StudyProgress(ProgressLine):
    """Count the trials of a study, and show them."""

    def __init__(
        self, total: int, done: int, file: TextIO, monotonic_s: Callable[[], float]
    ) -> None:
        """Start the clock; `done` trials are from earlier calls and do not count for the rate."""
        super().__init__(file, monotonic_s)
        self.total, self.before = total, done
        self.now = 0
        self.simulated_s = 0.0
        self.outcomes: Counter[str] = Counter()
        self._started_s = self._shown_s
        self._shown_s -= self._every_s

    def add(self, row: TrialRow) -> None:
        """Count a finished trial."""
        self.now += 1
        self.outcomes[row.outcome] += 1
        if isfinite(row.time_s):
            self.simulated_s += row.time_s

    @property
    def elapsed_s(self) -> float:
        """Time since the start of this call."""
        return self._monotonic_s() - self._started_s

    @property
    def hours_per_minute(self) -> float:
        """Simulated hours per minute of wall time."""
        return self.simulated_s / 60.0 / self.elapsed_s if self.elapsed_s > 0.0 else 0.0

    @property
    def left_s(self) -> float | None:
        """Expected time to the end; None before the first trial has ended."""
        if not self.now:
            return None
        return (self.total - self.before - self.now) * self.elapsed_s / self.now

    def line(self) -> str:
        """Return the progress as text."""
        done = self.before + self.now
        share = 100.0 * done / self.total if self.total else 100.0
        left = "" if self.left_s is None else f", {duration_text(self.left_s)} left"
        bad = self.outcomes["failed"]
        failures = f", {bad} failed" if bad else ""
        pace = f", {self.hours_per_minute:.1f} simulated h/min" if self.now else ""
        return f"{done}/{self.total} trials ({share:.0f} %){pace}{left}{failures}"


def duration_text(span_s: float) -> str:
    """Return a duration as "41 s", "7 min" or "3 h 05 min"."""
    if span_s < 90.0:
        return f"{span_s:.0f} s"
    minutes = round(span_s / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


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
