"""Progress of a study: trials done, simulated hours per minute, and time left."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from math import isfinite
from typing import Final, TextIO

from runtime.cli.terminal import CLEAR_LINE, steer
from study.runner.rows import TrialRow

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
