"""Explain at any instant of a recording why the robot turned."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

from ground.explain.explanation import Explanation, explain
from ground.explain.turning import turning_point
from ground.recording.log_index import LogIndex
from protocol.topics import CYCLE, DECISION, STATUS
from protocol.wire.messages import AvoidanceDecision, CycleReport, NavigatorStatus


class Turn(NamedTuple):
    """A turning point: its time since the start of the recording, and what changed."""

    at_ns: int
    words: str


class Recorded:
    """The decisions of a recording, each with the status and the cost of its tick."""

    def __init__(self, log_index: LogIndex) -> None:
        found = [
            (at_ns, one)
            for at_ns, one in log_index.on(DECISION.path)
            if type(one) is AvoidanceDecision
        ]
        self._times_ns = [at_ns for at_ns, _ in found]
        self._decisions = [decision for _, decision in found]
        self._statuses = {
            one.time_ns: one for _, one in log_index.on(STATUS.path) if type(one) is NavigatorStatus
        }
        self._cycles = {
            one.time_ns: one for _, one in log_index.on(CYCLE.path) if type(one) is CycleReport
        }

    def at(self, at_ns: int) -> tuple[int, Explanation] | None:
        """Explain the last decision up to then, with its time; None before the first."""
        place = self._place(at_ns)
        if place < 0:
            return None
        decision = self._decisions[place]
        before = self._decisions[place - 1] if place else None
        stamp_ns = decision.time_ns
        status, cycle = self._statuses.get(stamp_ns), self._cycles.get(stamp_ns)
        return self._times_ns[place], explain(decision, status, cycle, before)

    def _place(self, at_ns: int) -> int:
        """Return the index of the last decision up to then, or -1 before the first.

        Several decisions may arrive at one instant: then the first turning point among them.
        """
        last = bisect_right(self._times_ns, at_ns) - 1
        if last < 0:
            return last
        first = max(1, bisect_left(self._times_ns, self._times_ns[last]))
        decisions = self._decisions
        turned = (k for k in range(first, last) if turning_point(decisions[k - 1], decisions[k]))
        return next(turned, last)

    def turns(self) -> Iterator[Turn]:
        """Yield the turning points in order of time."""
        pairs = pairwise(self._decisions)
        for at_ns, (before, after) in zip(self._times_ns[1:], pairs, strict=True):
            point = turning_point(before, after)
            if point is not None:
                yield Turn(at_ns, point.words)
