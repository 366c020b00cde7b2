"""The last turning points of a robot that is being watched: one key asks why it turned."""

from collections import deque
from typing import Final

from ground.explain.explanation import Explanation, explain
from ground.explain.turning import TurningPoint, changes
from protocol.messages import AvoidanceDecision, CycleReport, NavigatorStatus

MOST: Final = 200


class Why:
    """Is given every decision there is and keeps the instants at which something changed."""

    def __init__(self, most: int = MOST) -> None:
        self._points: deque[tuple[TurningPoint, Explanation]] = deque(maxlen=most)
        self._newest: AvoidanceDecision | None = None

    def take(
        self,
        decision: AvoidanceDecision,
        status: NavigatorStatus | None,
        cycle: CycleReport | None = None,
    ) -> None:
        """The newest decision; one that was taken before changes nothing."""
        before, self._newest = self._newest, decision
        if before is None or before.time_ns >= decision.time_ns:
            return
        found = changes(before, decision)
        if found:
            point = TurningPoint(decision.time_ns, "; ".join(found), before, decision)
            self._points.append((point, explain(decision, status, cycle, before)))

    @property
    def points(self) -> list[TurningPoint]:
        """The oldest first."""
        return [point for point, _ in self._points]

    def at(self, back: int = 0) -> tuple[TurningPoint, Explanation] | None:
        """The last turning point, or one so many before it; None when there is none."""
        return self._points[-1 - back] if 0 <= back < len(self._points) else None
