"""How far a study is: trials, simulated hours per minute, and how long it will take."""

from collections import Counter
from collections.abc import Callable
from math import isfinite
from typing import Final, TextIO

from runtime.cli.terminal import CLEAR_LINE, steer
from study.runner.rows import TrialRow

REDRAW_EVERY_S: Final = 0.5
LOG_EVERY_S: Final = 30.0


class StudyProgress:
    """One line that is written over on a terminal, else a line now and then."""

    def __init__(
        self, total: int, done: int, file: TextIO, monotonic_s: Callable[[], float]
    ) -> None:
        """`done`: what was there before, which says nothing about the rate."""
        self.total, self.before = total, done
        self.now = 0
        self.simulated_s = 0.0
        self.outcomes: Counter[str] = Counter()
        self._file = file
        self._terminal = file.isatty()
        self._monotonic_s = monotonic_s
        self._started_s = monotonic_s()
        self._shown_s = self._started_s - (REDRAW_EVERY_S if self._terminal else LOG_EVERY_S)

    def add(self, row: TrialRow) -> None:
        self.now += 1
        self.outcomes[row.outcome] += 1
        if isfinite(row.time_s):
            self.simulated_s += row.time_s

    @property
    def elapsed_s(self) -> float:
        return self._monotonic_s() - self._started_s

    @property
    def hours_per_minute(self) -> float:
        return self.simulated_s / 60.0 / self.elapsed_s if self.elapsed_s > 0.0 else 0.0

    @property
    def left_s(self) -> float | None:
        """None before the first trial has ended."""
        if not self.now:
            return None
        return (self.total - self.before - self.now) * self.elapsed_s / self.now

    def show(self) -> None:
        """When it is time again."""
        every_s = REDRAW_EVERY_S if self._terminal else LOG_EVERY_S
        if self._monotonic_s() - self._shown_s >= every_s:
            self._shown_s = self._monotonic_s()
            self._write(self.line())

    def say(self, text: str) -> None:
        """Something else, on a line of its own."""
        if self._terminal:
            steer(self._file, CLEAR_LINE)
        print(text, file=self._file, flush=True)

    def close(self) -> None:
        """The last state, and the line is over."""
        self._write(self.line())
        if self._terminal:
            print(file=self._file, flush=True)

    def line(self) -> str:
        done = self.before + self.now
        share = 100.0 * done / self.total if self.total else 100.0
        left = "" if self.left_s is None else f", {in_words(self.left_s)} left"
        bad = self.outcomes["failed"]
        failures = f", {bad} failed" if bad else ""
        pace = f", {self.hours_per_minute:.1f} simulated h/min" if self.now else ""
        return f"{done}/{self.total} trials ({share:.0f} %){pace}{left}{failures}"

    def _write(self, line: str) -> None:
        if self._terminal:
            steer(self._file, CLEAR_LINE)
            print(line, end="", file=self._file, flush=True)
        else:
            print(line, file=self._file, flush=True)


def in_words(span_s: float) -> str:
    """A span as a person says it: 41 s, 7 min, 3 h 05 min."""
    if span_s < 90.0:
        return f"{span_s:.0f} s"
    minutes = round(span_s / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
