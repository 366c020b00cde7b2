"""Say in one sentence what the robot does and why, renewed slowly enough to be read."""

from textwrap import wrap
from typing import Final

from ground.app.panels.aged import MISSING, aged, live, role_of
from ground.app.widgets.rows import Row, Span, head, row
from ground.client.status_line import doing
from ground.explain.explanation import headline
from ground.station.station import Station
from ground.text.status_parts import state_role
from protocol.topics import DECISION, STATUS
from protocol.wire.messages import AvoidanceDecision, NavigatorStatus
from runtime.units import NS_PER_S

RENEWED_NS: Final = NS_PER_S // 2
GAP: Final = "  "
LEAST: Final = 8


class Sentence:
    """Keeps the sentence for half a second, unless the robot's state or branch changes."""

    def __init__(self) -> None:
        self._key: tuple[object, ...] = ()
        self._text = ""

    def rows(self, station: Station, width: int, most: int) -> list[Row]:
        """Return the state, then the sentence wrapped to exactly `most` rows."""
        seen = station.seen(STATUS)
        status: NavigatorStatus | None = live(seen)
        if status is None:
            first = row(head("state "), aged(seen, lambda _: MISSING))
            return [first, *(() for _ in range(most - 1))]
        state = doing(status).upper()
        decision: AvoidanceDecision | None = live(station.seen(DECISION))
        text = self._renewed(station, decision, status)
        lines = wrap(
            f"{state}{GAP}{text}", max(LEAST, width), max_lines=max(1, most), placeholder="…"
        )
        begin, rest = lines[0][: len(state)], lines[0][len(state) :]
        role = role_of(seen)
        first = row(Span(begin, state_role(status)), Span(rest, role))
        rows = [first, *(row(Span(line, role)) for line in lines[1:])]
        return [*rows, *(() for _ in range(most - len(rows)))]

    def _renewed(
        self, station: Station, decision: AvoidanceDecision | None, status: NavigatorStatus
    ) -> str:
        branch = None if decision is None else decision.branch
        state = (status.vehicle, status.mode, status.goal, status.vehicle_reason)
        key = (station.robot, state, branch, station.now_ns // RENEWED_NS)
        if key != self._key:
            self._key, self._text = key, headline(decision, status)
        return self._text
