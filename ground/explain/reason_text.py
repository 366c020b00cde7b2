"""The last turning points of a robot that is being shown: one key asks why it turned."""

from collections import deque
from typing import Final, NamedTuple, Protocol

from ground.explain.explanation import Explanation, explain
from ground.explain.turning import TurningPoint, turning_point
from protocol.wire.messages import AvoidanceDecision, CycleReport, NavigatorStatus

MOST: Final = 200
MANY: Final = 2_400
"""Of so many at once the older ones may have been left out."""


class Instant(Protocol):
    """What else was known at a moment."""

    @property
    def status(self) -> NavigatorStatus | None: ...
    @property
    def cycle(self) -> CycleReport | None: ...


class Shows(Protocol):
    """What is needed of a station; times are by its own clock."""

    @property
    def robot(self) -> str: ...
    @property
    def now_ns(self) -> int: ...
    def decisions(self, after_ns: int) -> list[tuple[int, AvoidanceDecision]]: ...
    def moment(self, time_ns: int | None = None) -> Instant | None: ...


class Turned(NamedTuple):
    """A turning point, and when it was heard of."""

    at_ns: int
    point: TurningPoint


class Why:
    """Looks at a station now and then and misses no decision that it still has."""

    def __init__(self, most: int = MOST) -> None:
        self._points: deque[Turned] = deque(maxlen=most)
        self._newest: AvoidanceDecision | None = None
        self._seen_ns = 0
        self._robot = ""

    def look(self, station: Shows) -> None:
        """Take what is new. Another robot begins anew; a log that is turned back forgets."""
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
        """The oldest first."""
        return [turned.point for turned in self._points]

    def at(self, back: int = 0) -> Turned | None:
        """The last one, or one so many before it; None when there is none."""
        return self._points[-1 - back] if 0 <= back < len(self._points) else None


def explained(turned: Turned, station: Shows) -> Explanation:
    """Why it turned then, with as much as the station still knows of that moment."""
    known = station.moment(turned.at_ns)
    status, cycle = (None, None) if known is None else (known.status, known.cycle)
    return explain(turned.point.decision, status, cycle, turned.point.previous)
