"""Explain why a robot turned: its last turning points, live or at an instant of a recording."""

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple

from ground.explain.explanation import Explanation, TurningPoint, explain, turning_point
from ground.recording.log_reader import LogIndex
from ground.station.station import Station
from protocol.topics import CYCLE, DECISION, STATUS
from protocol.wire.messages import AvoidanceDecision, CycleReport, NavigatorStatus

MOST: Final = 200
MANY: Final = 2_400
"""With this many decisions at once, older ones may be missing."""


class Turned(NamedTuple):
    """A turning point and its time of arrival."""

    at_ns: int
    point: TurningPoint


class Why:
    """Collects turning points; call `look` before the station drops decisions."""

    def __init__(self, most: int = MOST) -> None:
        self._points: deque[Turned] = deque(maxlen=most)
        self._newest: AvoidanceDecision | None = None
        self._seen_ns = 0
        self._robot = ""

    def look(self, station: Station) -> None:
        """Process new decisions; start again for another robot or after a jump back."""
        if station.robot != self._robot:
            self._robot, self._seen_ns = station.robot, 0
            self._points.clear()
            self._newest = None
        elif station.now_ns < self._seen_ns:
            self._turn_back(station.now_ns)
        found = station.decisions(self._seen_ns)
        if len(found) >= MANY:
            self._newest = None  # what came in between is not known
        for at_ns, decision in found:
            self._take(at_ns, decision)

    def _turn_back(self, now_ns: int) -> None:
        self._seen_ns = 0
        self._newest = None
        while self._points and self._points[-1].at_ns > now_ns:
            self._points.pop()
        if self._points:
            self._seen_ns = self._points[-1].at_ns
            self._newest = self._points[-1].point.decision

    def _take(self, at_ns: int, decision: AvoidanceDecision) -> None:
        before, self._newest, self._seen_ns = self._newest, decision, at_ns
        point = None if before is None else turning_point(before, decision)
        if point is not None:
            self._points.append(Turned(at_ns, point))

    @property
    def points(self) -> list[TurningPoint]:
        """Turning points, oldest first."""
        return [turned.point for turned in self._points]

    def at(self, back: int = 0) -> Turned | None:
        """Return the last turning point, or an earlier one; None when there is none."""
        return self._points[-1 - back] if 0 <= back < len(self._points) else None


def explained(turned: Turned, station: Station) -> Explanation:
    """Explain a turning point with what the station still knows of that moment."""
    known = station.moment(turned.at_ns)
    status, cycle = (None, None) if known is None else (known.status, known.cycle)
    return explain(turned.point.decision, status, cycle, turned.point.previous)


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
