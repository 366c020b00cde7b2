"""The progress of a search in one line."""

from collections.abc import Callable
from typing import Final, TextIO

from study.falsify.search import Budget, Search
from study.runner.progress import ProgressLine, duration_text

S_PER_H: Final = 3600.0


class SearchLine(ProgressLine):
    """Show the state of a search."""

    def __init__(
        self, search: Search, budget: Budget, file: TextIO, monotonic_s: Callable[[], float]
    ) -> None:
        super().__init__(file, monotonic_s)
        self._search, self._budget = search, budget

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
