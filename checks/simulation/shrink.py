"""Shrink a failing scenario: fewer events, a shorter run, the same invariant violated."""

from collections.abc import Callable, Sequence
from typing import Final

from checks.simulation.events import Event, EventScenario
from checks.simulation.simulation import RunResult, run

TAIL_NS: Final = 50_000_000
MAX_RUNS: Final = 400


def shrink(failed: RunResult, execute: Callable[[EventScenario], RunResult] = run) -> RunResult:
    """Return the smallest scenario found that violates the same invariant, with its result.

    Delta debugging over the list of events: first halves are left out, then quarters, down to
    single events. Raise ValueError for a result without a violation.
    """
    if failed.violation is None:
        raise ValueError("there is no violation to shrink")
    return _Shrinking(failed, failed.violation.invariant, execute).result()


class _Shrinking:
    def __init__(
        self, failed: RunResult, invariant: str, execute: Callable[[EventScenario], RunResult]
    ) -> None:
        self._best = failed
        self._invariant = invariant
        self._execute = execute
        self._left = MAX_RUNS

    def result(self) -> RunResult:
        """Shrink until no single event can be left out."""
        self._try(self._best.scenario.events)
        parts = 2
        while len(events := self._best.scenario.events) > 1 and self._left:
            parts = min(parts, len(events))
            if self._without_a_part(events, parts):
                parts = max(parts - 1, 2)
            elif parts == len(events):
                break
            else:
                parts *= 2
        return self._best

    def _without_a_part(self, events: Sequence[Event], parts: int) -> bool:
        """Leave out one of the parts if possible, and return whether it was."""
        for number in range(parts):
            first, last = len(events) * number // parts, len(events) * (number + 1) // parts
            if self._try((*events[:first], *events[last:])):
                return True
        return False

    def _try(self, events: Sequence[Event]) -> bool:
        best = self._best
        if best.violation is None or not self._left:
            return False
        self._left -= 1
        until_ns = best.violation.time_ns + TAIL_NS
        kept = tuple(event for event in events if event.time_ns <= until_ns)
        period_ns = 50_000_000
        duration_ns = -(-until_ns // period_ns) * period_ns
        found = self._execute(best.scenario._replace(duration_ns=duration_ns, events=kept))
        if found.violation is None or found.violation.invariant != self._invariant:
            return False
        self._best = found
        return True
