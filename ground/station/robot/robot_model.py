"""One robot as the station sees it: what it says, and what of it is lost."""

from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from typing import Final

from ground.client.parameter import Parameter
from ground.client.telemetry import Telemetry
from ground.station.bus_protocols import ReadableBus, Token
from ground.station.history.decision_history import Moments
from ground.station.history.inbox import Arrival, Inbox
from ground.station.history.telemetry_history import TelemetryHistory
from ground.station.link.presence_log import PresenceLog
from ground.station.link.restarts import RestartNotice, Restarts
from ground.station.link.streams import Streams
from ground.station.robot.mission_items import MissionItems
from ground.text.statustext import StatustextAssembler, aged
from protocol.topics import ANSWERED, COMMANDED, CYCLE, SONAR, TEXT, TOPICS, Role
from protocol.wire.codec import decode
from protocol.wire.enums import Severity
from protocol.wire.message import Message
from protocol.wire.messages import ParamValue, Statustext
from runtime.errors import RemoteError
from runtime.sequence import MAX_LATE_NS, MAX_LATE_TICKS

EVENTS: Final = frozenset((TEXT.path, COMMANDED.path, ANSWERED.path))

Tell = Callable[[str, str, int], None]
"""Source, words, severity."""


class RobotModel:
    """Everything of one robot that can be looked at without saying a word to it."""

    def __init__(
        self, bus: ReadableBus, robot: str, now_ns: int, tell: Tell, own: str = ""
    ) -> None:
        """`own`: our own identity on the bus."""
        self.robot = robot
        self.began_ns = self.gone_ns = now_ns
        self._inbox = Inbox()
        self.telemetry = Telemetry(bus, robot, TOPICS, taker=self._inbox.taker)
        self.parameters = ParameterList()
        self.streams = Streams(TOPICS)
        self.moments = Moments()
        self.figures = TelemetryHistory(self.telemetry, now_ns)
        self.again = RestartNotice(robot)
        self.restarts = {
            Role.ROBOT: Restarts(MAX_LATE_TICKS),
            Role.PLANT: Restarts(MAX_LATE_NS),
        }
        self.tokens: dict[Role, str] = {}
        self.charts = MissionItems()
        self._comings = PresenceLog(robot, own)
        self._texts = StatustextAssembler()
        self._tell = tell

    def poll(self, now_ns: int, present: Collection[Token]) -> set[Role]:
        """Look once; who has been restarted since the last time."""
        for coming in self._comings.see(present, now_ns):
            self._tell("ground", coming.text, coming.severity)
        again = self._see_tokens(present, now_ns) | self._see_counts()
        for role in again:
            self._restarted(role, now_ns)
        arrivals, overflowed = self._inbox.drain()
        if overflowed:
            self.streams.skip()
        for arrival in arrivals:
            self._take(arrival, now_ns)
        self.figures.poll(now_ns)
        return again

    def _take(self, arrival: Arrival, now_ns: int) -> None:
        self.streams.take(arrival)
        self.moments.take(arrival)
        if arrival.path in EVENTS:
            with suppress(RemoteError):  # the mailbox has counted it
                self._event(decode(arrival.frame).message, arrival.arrived_ns, now_ns)

    def _event(self, message: Message, told_ns: int, now_ns: int) -> None:
        """What was told before we came, or while we were cut off, says how long ago that was."""
        if isinstance(message, Statustext):
            text = self._texts.receive(message)
            if text:
                self.again.hear(text, told_ns)
                self._tell(self.robot, aged(text, now_ns - told_ns), message.severity)
        elif isinstance(message, ParamValue):
            self.parameters.changed(message)
        else:
            self.charts.hear(message)

    def _see_tokens(self, present: Iterable[Token], now_ns: int) -> set[Role]:
        found = {token.role: token.zid for token in present if token.robot == self.robot}
        again = set()
        for role in (Role.ROBOT, Role.PLANT):
            zid = found.get(role.value, "")
            if role is Role.ROBOT and not zid and self.tokens.get(role):
                self.gone_ns = now_ns
            self.tokens[role] = zid
            if self.restarts[role].token(zid):
                again.add(role)
        return again

    def _see_counts(self) -> set[Role]:
        again = set()
        cycle, scan = self.telemetry.latest(CYCLE), self.telemetry.latest(SONAR)
        if cycle is not None and self.restarts[Role.ROBOT].number(cycle[0].tick):
            again.add(Role.ROBOT)
        if scan is not None and self.restarts[Role.PLANT].number(scan[0].time_ns):
            again.add(Role.PLANT)
        return again

    def _restarted(self, role: Role, now_ns: int) -> None:
        words = self.again.begun(role, self.restarts[role].count, now_ns)
        self._tell("ground", words, Severity.WARNING)
        if role is Role.ROBOT:
            self.figures.restart()


class ParameterList:
    """After a loss there are none until all were read again."""

    def __init__(self) -> None:
        self.rows: tuple[Parameter, ...] | None = None
        self._known = 0
        self._why = ""

    def lose(self) -> None:
        self.rows = None
        self._why = ""

    def read(self, rows: tuple[Parameter, ...]) -> None:
        self.rows = rows
        self._known = len(rows)
        self._why = ""

    def failed(self, why: str) -> None:
        self._why = why

    def changed(self, value: ParamValue) -> None:
        """Somebody has set one: the robot has said its new value."""
        if self.rows is None:
            return
        self.rows = tuple(
            row.with_value(value.param_value) if row.name == value.param_id else row
            for row in self.rows
        )

    def words(self, asked: int) -> str:
        """How many there are, or how many are missing and why."""
        if self.rows is not None:
            return f"{len(self.rows)}"
        missing = f"all {self._known} missing" if self._known else "not read yet"
        times = f"asked {asked} {'time' if asked == 1 else 'times'}" if asked else "not asked yet"
        return f"{missing}: {times}{f', {self._why}' if self._why else ''}"
