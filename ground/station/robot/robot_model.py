"""Model one robot as the station sees it."""

from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from typing import Any, Final

from ground.client.parameter import Parameter
from ground.client.requests import NAMED_NS, replaced_by
from ground.client.telemetry import Telemetry
from ground.station.bus_protocols import ReadableBus, Token
from ground.station.history.decision_history import DecisionHistory
from ground.station.history.event_log import Inbox, ReceivedFrame
from ground.station.history.telemetry_history import TelemetryHistory
from ground.station.link.processes import LineBudget, PresenceLog, RestartNotice, Restarts
from ground.station.link.streams import Streams
from ground.station.robot.mission_items import MissionItems
from ground.text.wording import aged, driving
from protocol.bus.bus import Bus
from protocol.outcome import REPLACED
from protocol.topics import (
    ANSWERED,
    COMMANDED,
    CYCLE,
    LEASE,
    SONAR,
    STATUS,
    SUMMARIES,
    TEXT,
    TOPICS,
    Role,
    Topic,
)
from protocol.wire.codec import decode
from protocol.wire.enums import Severity
from protocol.wire.message import Message
from protocol.wire.messages import LeaseStatus, NavigatorStatus, ParamValue, Statustext
from protocol.wire.statustext import StatustextAssembler
from runtime.cli.terminal import printable
from runtime.errors import RemoteError
from runtime.sequence import MAX_LATE_NS, MAX_LATE_TICKS
from runtime.units import PERIOD_NS

EVENTS: Final = frozenset((TEXT.path, COMMANDED.path, ANSWERED.path))
ALL: Final = tuple(topic for topic in TOPICS if topic not in SUMMARIES.values())
"""What a robot publishes, each message once."""
WATCHED: Final[tuple[Topic[Any], ...]] = (*SUMMARIES.values(), TEXT)
"""What is enough of a robot that is neither shown nor commanded."""

AddLine = Callable[[str, str, int], None]
"""Arguments: source, text, severity."""


class RobotModel:
    """Everything that can be shown of a robot without sending anything to it."""

    def __init__(
        self,
        bus: ReadableBus,
        robot: str,
        now_ns: int,
        epoch_ns: int,
        add_line: AddLine,
        own: str = "",
    ) -> None:
        """Create a model; its history counts from `epoch_ns`, the start of the station.

        `own` is this station's identity on the bus.
        """
        self.robot = robot
        self.began_ns = self.gone_ns = now_ns
        self._inbox = Inbox()
        self._live_bus = bus if isinstance(bus, Bus) else None
        topics = ALL if self._live_bus is None else WATCHED
        self.telemetry = Telemetry(bus, robot, topics, taker=self._inbox.taker)
        self.parameters = ParameterList()
        self.streams = Streams(TOPICS)
        self.decision_history = DecisionHistory()
        self.figures = TelemetryHistory(self.telemetry, epoch_ns)
        self.restart_notice = RestartNotice(robot)
        self.restarts = {
            Role.ROBOT: Restarts(MAX_LATE_TICKS),
            Role.PLANT: Restarts(MAX_LATE_NS),
        }
        self.tokens: dict[Role, str] = {}
        self.mission_items = MissionItems()
        self.is_selected = False
        """True while the end of each of its goals is told."""
        self._goals = GoalChanges()
        self.plant_radius_m: float | None = None
        """Radius of the simulated robot, if its plant has told it."""
        self._restart_lines = LineBudget()
        self._presence_log = PresenceLog(robot, own)
        self._present: Collection[Token] | None = None
        self._texts = StatustextAssembler()
        self._add_line = add_line

    def poll(self, now_ns: int, present: Collection[Token]) -> set[Role]:
        """Process everything new; return the roles that were restarted since the last call.

        `present` is the same object as long as no token of this robot has changed.
        """
        restarted_roles = self._restarts_by_counter()
        if present is not self._present:
            self._present = present
            for change in self._presence_log.update(present, now_ns):
                self._add_line("ground", change.text, change.severity)
            restarted_roles |= self._restarts_by_token(present, now_ns)
        for role in restarted_roles:
            self._restarted(role, now_ns)
        arrivals, overflowed = self._inbox.drain()
        if overflowed:
            self.streams.skip()
        for arrival in arrivals:
            self._take(arrival, now_ns)
        lease = self.telemetry.latest(LEASE)
        if words := self._goals.words(None if lease is None else lease[0], now_ns):
            self._add_line("ground", f"{self.robot}: {words}", Severity.INFO)
        self.figures.poll(now_ns, self.radius_m)
        return restarted_roles

    def follow_all(self, follows: bool) -> None:
        """Subscribe to everything of this robot, or only to its summary.

        The events of a robot that was followed go on: they are rare, and those that were missed
        would have to be fetched again.
        """
        if self._live_bus is None or follows is self.telemetry.is_followed(STATUS):
            return
        events = [topic for topic in ALL if not topic.rate_hz and self.telemetry.is_followed(topic)]
        self.streams.skip()
        self.telemetry.follow(self._live_bus, ALL if follows else {*WATCHED, *events})

    @property
    def radius_m(self) -> float | None:
        """Radius of the robot by its own parameter, else by its plant; None while unknown."""
        own_m = self.parameters.value("radius_m")
        return self.plant_radius_m if own_m is None else own_m

    def _take(self, arrival: ReceivedFrame, now_ns: int) -> None:
        self.streams.take(arrival)
        self.decision_history.take(arrival)
        if arrival.path == STATUS.path and self.is_selected:
            with suppress(RemoteError):
                self._goals.receive(decode(arrival.frame).message, arrival.arrived_ns)
        if arrival.path in EVENTS:
            with suppress(RemoteError):  # the mailbox has counted it
                self._event(decode(arrival.frame).message, arrival.arrived_ns, now_ns)

    def _event(self, message: Message, published_ns: int, now_ns: int) -> None:
        """Process an event; one published long ago is shown with its age."""
        if isinstance(message, Statustext):
            text = self._texts.receive(message)
            if text:
                self.restart_notice.receive(text, published_ns)
                self._add_line(self.robot, aged(text, now_ns - published_ns), message.severity)
        elif isinstance(message, ParamValue):
            self.parameters.changed(message)
        else:
            self.mission_items.receive(message)

    def _restarts_by_token(self, present: Iterable[Token], now_ns: int) -> set[Role]:
        found = {token.role: token.zid for token in present if token.robot == self.robot}
        restarted_roles = set()
        for role in (Role.ROBOT, Role.PLANT):
            zid = found.get(role.value, "")
            if role is Role.ROBOT and not zid and self.tokens.get(role):
                self.gone_ns = now_ns
            self.tokens[role] = zid
            if self.restarts[role].token(zid):
                restarted_roles.add(role)
        return restarted_roles

    def _restarts_by_counter(self) -> set[Role]:
        restarted_roles = set()
        cycle, scan = self.telemetry.latest(CYCLE), self.telemetry.latest(SONAR)
        if cycle is not None and self.restarts[Role.ROBOT].number(cycle[0].tick):
            restarted_roles.add(Role.ROBOT)
        if scan is not None and self.restarts[Role.PLANT].number(scan[0].time_ns):
            restarted_roles.add(Role.PLANT)
        return restarted_roles

    def _restarted(self, role: Role, now_ns: int) -> None:
        self.streams.skip(role)
        words = self.restart_notice.begin(role, self.restarts[role].count, now_ns)
        if self._restart_lines.take(1, now_ns):
            self._add_line("ground", words, Severity.WARNING)
        if role is Role.ROBOT:
            self.figures.restart()
            self.parameters.forget()


class GoalChanges:
    """Tells when a goal that is under way is replaced by another one, and whose that is.

    Each status counts: the one that is missing may have shown that the goal was reached.
    """

    def __init__(self) -> None:
        self._last: NavigatorStatus | None = None
        self._old: NavigatorStatus | None = None
        self._changed_ns = 0

    def receive(self, status: Message, now_ns: int) -> None:
        """Process the next status; ignore any other message."""
        if not isinstance(status, NavigatorStatus):
            return
        last, self._last = self._last, status
        if last is None or not driving(last) or status.goal_id in (0, last.goal_id):
            return
        if 0 < status.time_ns - last.time_ns < 2 * PERIOD_NS:
            self._old, self._changed_ns = last, now_ns

    def words(self, lease: LeaseStatus | None, now_ns: int) -> str:
        """Return the change once, when the operator of the new goal is known, or soon after."""
        old, new = self._old, self._last
        if old is None or new is None:
            return ""
        is_named = lease is not None and lease.drive_id == new.goal_id
        driver = printable(lease.driver) if lease is not None and is_named else ""
        if not driver and now_ns - self._changed_ns < NAMED_NS:
            return ""
        self._old = None
        place = f"{old.goal_x_m:z.1f} {old.goal_y_m:z.1f}"
        return f"goal {place} {REPLACED} {replaced_by(new, driver)}"


class ParameterList:
    """The robot's parameters; after a loss, `rows` is None until all of them were read again."""

    def __init__(self) -> None:
        self.rows: tuple[Parameter, ...] | None = None
        self._values: dict[str, float] = {}
        self._known = 0
        self._why = ""

    def value(self, name: str) -> float | None:
        """Return the value that the robot reported last, also during a loss; None while unknown.

        A robot that is lost keeps to the limits that it had.
        """
        return self._values.get(name)

    def lose(self) -> None:
        """Require that all are read again, after a loss."""
        self.rows = None
        self._why = ""

    def forget(self) -> None:
        """Forget all values: a restarted robot may have others."""
        self._values = {}

    def read(self, rows: tuple[Parameter, ...]) -> None:
        """Store the complete list."""
        self.rows = rows
        self._values = {row.name: row.value for row in rows}
        self._known = len(rows)
        self._why = ""

    def failed(self, why: str) -> None:
        """Note why reading failed."""
        self._why = why

    def changed(self, value: ParamValue) -> None:
        """Note a new value that the robot reported."""
        self._values[value.param_id] = value.param_value
        if self.rows is None:
            return
        self.rows = tuple(
            row.with_value(value.param_value) if row.name == value.param_id else row
            for row in self.rows
        )

    def words(self, asked: int) -> str:
        """Return the number of parameters, or why they are missing."""
        if self.rows is not None:
            return f"{len(self.rows)}"
        missing = f"all {self._known} missing" if self._known else "not read yet"
        times = (
            f"requested {asked} {'time' if asked == 1 else 'times'}"
            if asked
            else "not requested yet"
        )
        return f"{missing}: {times}{f', {self._why}' if self._why else ''}"
