"""Keep the last turning points of the shown robot, to explain why it turned."""

from collections import deque
from typing import Final, NamedTuple

from ground.explain.explanation import Explanation, explain
from ground.explain.turning import TurningPoint, turning_point
from ground.station.station import Station
from protocol.wire.messages import AvoidanceDecision

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
