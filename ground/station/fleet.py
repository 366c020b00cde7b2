"""Watch every robot that appears, and list them, those that need attention first.

Robots that are long gone are replaced when there are too many.
"""

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from enum import IntEnum
from math import isfinite
from typing import Final, NamedTuple

from ground.client.connection import Common
from ground.client.floor import Floor, floor_in
from ground.client.leases import Leasing
from ground.client.status_line import PLACE_UNKNOWN, doing, knows_place
from ground.client.telemetry import Age, AgedMessage
from ground.robot import Robot
from ground.station.bus_protocols import ReadableBus, Token
from ground.station.link.link_monitor import HubState
from ground.station.link.loss import Loss, LossKind
from ground.station.reader import Reading
from ground.station.robot.command_queue import Begin
from ground.station.robot.robot_model import AddLine, RobotModel
from ground.station.robot.robot_session import RobotSession
from protocol.bus.bus import Bus
from protocol.bus.network import MAX_ROBOTS
from protocol.topics import ODOMETRY, STATUS
from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.messages import NavigatorStatus
from runtime.clock import Clock
from runtime.units import NS_PER_S

KEPT_NS: Final = 10 * NS_PER_S
"""A robot that disappeared is not replaced by another one before this time."""
EVERY: Final = 4
"""A robot that is only watched is polled at one of so many polls; in a recording, at each."""
MOST_A_POLL: Final = 16
"""About so many of them are polled at once: with a hundred, each at one of six polls."""


class Fleet:
    """Models of all watched robots, and their sessions on a live bus.

    At most `MAX_ROBOTS` are watched, and those that were selected.
    """

    def __init__(
        self,
        bus: ReadableBus,
        common: Common,
        clock: Clock,
        begin: Begin,
        add_line: AddLine,
        name: str = "",
    ) -> None:
        """Serve the operator with this name."""
        self.models: dict[str, RobotModel] = {}
        self.sessions: dict[str, RobotSession] = {}
        self.unwatched: tuple[str, ...] = ()
        """Names of robots that are present, but too many to be watched."""
        self._bus = bus
        self._live_bus = bus if isinstance(bus, Bus) else None
        self._common = common
        self._clock = clock
        self._begin = begin
        self._add_line = add_line
        self._name = name
        self._began_ns = clock.now_ns()
        self._hub_state = HubState()
        self._reading: set[str] = set()
        """Whose request is under way: one of the selected robot, and one of the others."""

        self._polls = 0
        self._entries: dict[str, RosterEntry] = {}
        """Those of robots that were not polled since."""
        self._present: tuple[Token, ...] = ()
        self._tokens: Mapping[str, tuple[Token, ...]] = {}

    def add(self, robot: str) -> None:
        """Watch a robot; the number of robots is not limited here."""
        now_ns, bus = self._clock.now_ns(), self._live_bus
        own = "" if bus is None else bus.zid
        model = RobotModel(self._bus, robot, now_ns, self._began_ns, self._add_line, own)
        self.models[robot] = model
        if bus is not None:
            self.sessions[robot] = RobotSession(
                self._robot(bus, robot),
                model,
                self._add_line,
                self._hub_state,
            )

    def _robot(self, bus: Bus, name: str) -> Robot:
        """Return a robot whose lease, heartbeat and goals the station itself looks after."""

        def floor() -> Floor | None:
            world = self.sessions[name].link_monitor.world
            return None if world is None else floor_in(world.text)

        return Robot(
            bus,
            replace(self._common, robot=name),
            self._name,
            clock=self._clock,
            leasing=Leasing.NEVER,
            follows=False,
            floor=floor,
        )

    def watch(self, present: Collection[str], now_ns: int) -> list[str]:
        """Watch the robots that are present, as far as there is room; return the new ones."""
        new = [robot for robot in present if robot not in self.models]
        if not new:
            self.unwatched = ()
            return []
        room = MAX_ROBOTS - len(self.models)
        if len(new) > room:
            room += self._replace(len(new) - room, present, now_ns)
        added = new[: max(0, room)]
        for robot in added:
            self.add(robot)
        self.unwatched = tuple(new[len(added) :])
        return added

    def _replace(self, count: int, present: Collection[str], now_ns: int) -> int:
        """End the watch of robots that are long gone, the longest first; return their number."""
        if self._live_bus is None:
            return 0
        gone = [
            model
            for robot, model in self.models.items()
            if robot not in present
            and now_ns - model.gone_ns >= KEPT_NS
            and self.sessions[robot].can_end
        ]
        ended = sorted(gone, key=lambda model: model.gone_ns)[:count]
        for model in ended:
            self._end(model)
        return len(ended)

    def forget(self) -> None:
        """Forget all robots, because their processes are replaced by others."""
        for model in list(self.models.values()):
            self._end(model)

    def _end(self, model: RobotModel) -> None:
        del self.models[model.robot]
        self._entries.pop(model.robot, None)
        if self._live_bus is not None:
            self.sessions.pop(model.robot).close()
            for mailbox in model.telemetry.boxes().values():
                self._live_bus.unsubscribe(mailbox)

    def poll(self, present: Iterable[Token], selected: str, now_ns: int) -> None:
        """Process what is new of the robots that are due, and send the next requests."""
        tokens = self._by_robot(tuple(present))
        self._polls += 1
        every = max(EVERY, len(self.models) // MOST_A_POLL)
        for number, (robot, model) in enumerate(self.models.items()):
            session = self.sessions.get(robot)
            is_busy = robot == selected or session is None or session.is_busy
            if not is_busy and (number + self._polls) % every:
                continue
            self._entries.pop(robot, None)
            restarted_roles = model.poll(now_ns, tokens.get(robot, ()))
            if session is not None:
                session.poll(now_ns, restarted_roles)
        self._read(selected, now_ns)

    def _by_robot(self, present: tuple[Token, ...]) -> Mapping[str, tuple[Token, ...]]:
        """Return the tokens of each robot; the same objects until a token has changed."""
        if present != self._present:
            self._present = present
            by_robot: defaultdict[str, tuple[Token, ...]] = defaultdict(tuple)
            for token in present:
                by_robot[token.robot] += (token,)
            self._tokens = by_robot
        return self._tokens

    def _read(self, selected: str, now_ns: int) -> None:
        """Send the next request to the selected robot, and one to the others in turn."""
        own = [one.reader for robot, one in self.sessions.items() if robot == selected]
        others = [one.reader for robot, one in self.sessions.items() if robot != selected]
        for whose, readers in (("selected", own), ("watched", others)):
            if whose in self._reading:
                continue
            for reader in sorted(readers, key=lambda reader: reader.asked_ns):
                if (reading := reader.due(now_ns)) is not None:
                    self._reading.add(whose)
                    self._begin(self._carry_out(whose, reading))
                    break

    async def _carry_out(self, whose: str, reading: Reading) -> None:
        try:
            await reading()
        finally:
            self._reading.discard(whose)

    def roster(self, selected: str, now_ns: int, *, links: bool = False) -> "list[RosterEntry]":
        """Return an entry for each watched robot, the most urgent first, then by name.

        With `links`, the share of delivered frames is computed, too. An entry is built anew when
        its robot has been polled.
        """
        entries = self._entries
        for robot in self.models:
            known, is_selected = entries.get(robot), robot == selected
            if known is None or known.is_selected is not is_selected:
                entries[robot] = _entry(self, robot, is_selected, now_ns)
        found = by_attention(entries.values())
        if not links:
            return found
        return [
            entry._replace(link_percent=self.models[entry.robot].streams.percent(now_ns))
            for entry in found
        ]

    def close(self) -> None:
        """Let the threads end."""
        for session in self.sessions.values():
            session.close()


class Attention(IntEnum):
    """Ranks of the roster, the most urgent first."""

    STOPPED = 0
    """In failsafe or emergency stop, or a stop is not acknowledged."""
    STUCK = 1
    LOST = 2
    """No live status, or a loss."""
    UNPLACED = 3
    """Its position is unknown, so it refuses goals in the world."""
    NONE = 4


LOST_WORDS: Final = {
    LossKind.ROUTER_GONE: "no router",
    LossKind.TRANSPORT: "link lost",
    LossKind.PROCESS_DEAD: "dead",
    LossKind.HUNG: "hung",
    LossKind.SENSES_STALE: "no sensor data",
}


class RosterEntry(NamedTuple):
    """One robot: its state in words, its status with age, its loss and its link.

    `stopping` describes a stop that is not acknowledged. `goal_distance_m` is None without a goal
    or a live status. `link_percent` is None unless it was asked for. `round_trip_ms` is measured
    each 5 s of robots that are not selected.
    """

    robot: str
    is_selected: bool
    attention: Attention
    words: str
    status: AgedMessage
    goal_distance_m: float | None = None
    loss: Loss | None = None
    stopping: str = ""
    link_percent: float | None = None
    round_trip_ms: float | None = None

    @property
    def needs_attention(self) -> bool:
        """True for a robot that stopped itself, is stuck or lost, or has an unknown position."""
        return self.attention is not Attention.NONE


def by_attention(entries: Iterable[RosterEntry]) -> list[RosterEntry]:
    """Sort by attention, then by name with numbers in their order."""
    return sorted(entries, key=lambda entry: (entry.attention, *name_key(entry.robot)))


def name_key(robot: str) -> tuple[str, int, str]:
    """Return a sort key by which r2 comes before r10."""
    stem = robot.rstrip("0123456789")
    number = robot[len(stem) :]
    return stem, int(number or "0"), robot


def _entry(fleet: Fleet, robot: str, is_selected: bool, now_ns: int) -> RosterEntry:
    model, session = fleet.models[robot], fleet.sessions.get(robot)
    status = model.telemetry.seen(STATUS, now_ns)
    loss = None if session is None else session.link_monitor.loss()
    stopping = "" if session is None else session.stop.words
    trip_ns = None if session is None else session.link_monitor.round_trip_ns
    odometry = model.telemetry.latest(ODOMETRY)
    placed = odometry is None or knows_place(odometry[0])
    return RosterEntry(
        robot=robot,
        is_selected=is_selected,
        attention=attention_of(status, loss, stopping, placed=placed),
        words=words_of(status, loss, placed=placed),
        status=status,
        goal_distance_m=distance_m(status),
        loss=loss,
        stopping=stopping,
        round_trip_ms=None if trip_ns is None else trip_ns / 1e6,
    )


def attention_of(
    status: AgedMessage, loss: Loss | None, stopping: str = "", *, placed: bool = True
) -> Attention:
    """Return the rank of a robot with this newest status.

    A robot that stopped itself and is then lost keeps its rank: it is still stopped.
    """
    message = status.message
    if stopping:
        return Attention.STOPPED
    if isinstance(message, NavigatorStatus):
        if message.vehicle in (Vehicle.FAILSAFE, Vehicle.EMERGENCY_STOP):
            return Attention.STOPPED
        if status.age is not Age.GONE and message.goal == GoalState.STUCK:
            return Attention.STUCK
    lost = loss is not None and loss.kind is not LossKind.OTHER_OPERATOR
    if lost or status.age is Age.GONE:
        return Attention.LOST
    return Attention.NONE if placed else Attention.UNPLACED


def words_of(status: AgedMessage, loss: Loss | None, *, placed: bool = True) -> str:
    """Return the state in words: the vehicle or goal state, and what is lost or unknown."""
    message = status.message
    lost = "" if loss is None else LOST_WORDS.get(loss.kind, "")
    if not isinstance(message, NavigatorStatus):
        return lost or "no data"
    if status.age is Age.GONE:
        return lost or "stale"
    unknown = "" if placed else PLACE_UNKNOWN.lower()
    return ", ".join(filter(None, (doing(message), lost or unknown)))


def distance_m(status: AgedMessage) -> float | None:
    """Return the distance to the goal of a live status; None without a goal under way."""
    message = status.message
    if not isinstance(message, NavigatorStatus) or status.age is Age.GONE:
        return None
    under_way = GoalState.ACCEPTED <= message.goal <= GoalState.ALIGNING
    return message.goal_distance_m if under_way and isfinite(message.goal_distance_m) else None
