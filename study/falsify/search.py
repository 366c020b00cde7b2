"""The search: climbs in the order of their numbers, and shrinking of the first of each class.

Results are taken in the order of the climbs, so that the findings do not depend on the number of
processes.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TextIO

from runtime.errors import UserError
from study.falsify.climb import Climb, SearchSettings, Violation, climb
from study.falsify.findings import (
    ClassRecord,
    Finding,
    SearchProgress,
    finding_of,
    picture,
    save_finding,
    save_index,
    save_progress,
)
from study.falsify.properties import time_limit_s
from study.falsify.shrink import shrunk, walls_in
from study.runner.conduct import ProgressLine, duration_text
from study.runner.workers import Workers

AHEAD: Final = 2
"""Climbs in flight for each task that the workers run at the same time."""

SAVE_EVERY_S: Final = 5.0
REFRESH_S: Final = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchBudget:
    """Limits of a search: the time, and the number of trials; None is no limit."""

    span_s: float | None = None
    trials: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Shrunk:
    """A finished finding."""

    failure_class: str
    finding: Finding
    drawn: str
    walls: int
    trials: int


@dataclass(slots=True)
class Search:
    """The state of a running search."""

    settings: SearchSettings
    directory: Path
    progress: SearchProgress
    monotonic_s: Callable[[], float]
    running: dict["Future[Any]", int | str] = field(default_factory=dict)
    early: dict[int, Climb] = field(default_factory=dict)
    next_climb: int = 0
    started_s: float = 0.0
    before_s: float = 0.0
    saved_s: float = 0.0

    def run(self, workers: Workers, budget: SearchBudget) -> Iterator[None]:
        """Search until the budget is used up; yield about twice a second and after each result.

        Raises UserError when a process has died.
        """
        executor = workers.executor
        self.started_s = self.saved_s = self.monotonic_s()
        self.before_s = self.progress.spent_s
        self.next_climb = self.progress.climbs
        for number in sorted(
            one.climb for one in self.progress.classes.values() if not one.sentence
        ):
            self._submit_again(executor, number)
        while True:
            while len(self.running) < AHEAD * workers.threads() and not self.is_over(budget):
                self._submit(executor, self.next_climb, climb, self.settings, self.next_climb)
                self.next_climb += 1
            if not self.running:
                return
            done, _ = wait(self.running, REFRESH_S, FIRST_COMPLETED)
            for future in sorted(done, key=lambda one: str(self.running[one])):
                self._take(executor, self.running.pop(future), _result(future), budget)
            self.progress.spent_s = self.spent_s
            if self.monotonic_s() - self.saved_s >= SAVE_EVERY_S:
                self.save()
            yield

    @property
    def spent_s(self) -> float:
        """Time used in all calls."""
        return self.before_s + self.monotonic_s() - self.started_s

    def is_over(self, budget: SearchBudget) -> bool:
        """Return whether the budget is used up."""
        if budget.trials is not None and self.progress.trials >= budget.trials:
            return True
        return budget.span_s is not None and self.spent_s >= budget.span_s

    def save(self) -> None:
        """Store the progress and the list of findings."""
        self.saved_s = self.monotonic_s()
        self.progress.spent_s = self.spent_s
        save_progress(self.directory, self.progress)
        save_index(self.directory, self.progress)

    def _submit(self, executor: Executor, key: int | str, call: Any, *args: Any) -> None:
        try:
            self.running[executor.submit(call, *args)] = key
        except BrokenExecutor as error:
            raise _died(error) from None

    def _submit_again(self, executor: Executor, number: int) -> None:
        """Shrink the classes of an earlier climb that have no finding yet."""
        classes = [
            name
            for name, one in self.progress.classes.items()
            if one.climb == number and not one.sentence
        ]
        for name in classes:
            self._submit(executor, name, shrink_again, self.settings, number, name)

    def _take(self, executor: Executor, key: int | str, result: Any, budget: SearchBudget) -> None:
        if isinstance(result, Shrunk):
            save_finding(self.directory, result.finding, result.drawn)
            record = self.progress.classes[result.failure_class]
            record.walls, record.sentence = result.walls, result.finding.sentence
            record.after_s = self.spent_s
            self.save()
            return
        self.early[result.number] = result
        while (found := self.early.pop(self.progress.climbs, None)) is not None:
            if budget.trials is not None and self.progress.trials >= budget.trials:
                continue
            self._count(executor, found)

    def _count(self, executor: Executor, found: Climb) -> None:
        """Count a climb; shrink its violations of new classes."""
        progress = self.progress
        progress.climbs += 1
        progress.trials += found.trials
        progress.simulated_s += found.simulated_s
        for violation in found.violations:
            name = violation.failure_class
            if name in progress.classes:
                progress.classes[name].seen += 1
                continue
            progress.classes[name] = ClassRecord(climb=found.number)
            self._submit(executor, name, shrink, self.settings, violation)


def shrink(settings: SearchSettings, violation: Violation) -> Shrunk:
    """Shrink a violation to a finding with its picture."""
    name = violation.failure_class
    smallest, trials = shrunk(settings, violation)
    limit_s = time_limit_s(smallest.world)
    finding = finding_of(settings.subject, violation.letter, smallest, limit_s, name)
    return Shrunk(
        failure_class=name,
        finding=finding,
        drawn=picture(finding),
        walls=walls_in(smallest.world),
        trials=trials,
    )


def shrink_again(settings: SearchSettings, number: int, name: str) -> Shrunk:
    """Repeat a climb and shrink its violation of a class."""
    violations = climb(settings, number).violations
    return shrink(settings, next(one for one in violations if one.failure_class == name))


def _result(future: "Future[Any]") -> Any:
    try:
        return future.result()
    except BrokenExecutor as error:
        raise _died(error) from None


def _died(error: BaseException) -> UserError:
    return UserError(
        f"a worker process died ({error}); findings are kept: give the same command again, with "
        "fewer --jobs if memory is short"
    )


S_PER_H: Final = 3600.0


class SearchLine(ProgressLine):
    """Show the state of a search."""

    def __init__(
        self, search: Search, budget: SearchBudget, file: TextIO, monotonic_s: Callable[[], float]
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
