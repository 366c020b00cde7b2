"""The progress of a search in one line, in the style of the study."""

from collections.abc import Callable
from typing import Final, TextIO

from runtime.cli.terminal import CLEAR_LINE, steer
from study.falsify.search import Budget, Search
from study.runner.progress import LOG_EVERY_S, REDRAW_EVERY_S, duration_text

S_PER_H: Final = 3600.0


class ProgressLine:
    """Show a search: overwritten on a terminal, printed at intervals elsewhere."""

    def __init__(
        self, search: Search, budget: Budget, file: TextIO, monotonic_s: Callable[[], float]
    ) -> None:
        self._search, self._budget, self._file = search, budget, file
        self._monotonic_s = monotonic_s
        self._terminal = file.isatty()
        self._shown_s = monotonic_s()

    def show_if_due(self) -> None:
        """Show the progress if the interval has passed."""
        every_s = REDRAW_EVERY_S if self._terminal else LOG_EVERY_S
        if self._monotonic_s() - self._shown_s >= every_s:
            self._shown_s = self._monotonic_s()
            self._write(self.line())

    def close(self) -> None:
        """Show the final state and end the line."""
        self._write(self.line())
        if self._terminal:
            print(file=self._file, flush=True)

    def line(self) -> str:
        """Return the progress as text."""
        progress, search = self._search.progress, self._search
        found = [one for one in progress.classes.values() if one.sentence]
        shrinking = len(progress.classes) - len(found)
        more = f" ({shrinking} not yet shrunk)" if shrinking else ""
        pace = progress.simulated_s / S_PER_H / (search.spent_s / 60.0) if search.spent_s else 0.0
        return (
            f"{progress.trials} trials in {progress.climbs} climbs, {pace:.1f} simulated h/min, "
            f"classes of failure: {len(progress.classes)}{more}{self._left()}"
        )

    def _left(self) -> str:
        if self._budget.span_s is None:
            return ""
        return f", {duration_text(max(0.0, self._budget.span_s - self._search.spent_s))} left"

    def _write(self, line: str) -> None:
        if self._terminal:
            steer(self._file, CLEAR_LINE)
            print(line, end="", file=self._file, flush=True)
        else:
            print(line, file=self._file, flush=True)
