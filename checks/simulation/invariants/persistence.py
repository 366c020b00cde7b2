"""Invariants of persistence: acknowledged changes and the emergency stop survive a restart.

A stop is acknowledged in time, and released only by a later clear. What arrives at the robot is
noted here, at its door, so that nothing depends on what the robot makes of it.
"""

from collections import defaultdict
from contextlib import suppress
from typing import Any, Final

from checks.simulation.hosts.operators import OperatorRequest
from checks.simulation.invariants import limits
from checks.simulation.invariants.commanding import RELEASED, accepted
from checks.simulation.invariants.limits import NEVER, RunState
from protocol.topics import COMMAND, STOP, STOP_SERVICE, operator_in
from protocol.wire.codec import decode
from protocol.wire.enums import Command, MissionType
from protocol.wire.message import Message, wire_of
from protocol.wire.messages import (
    CommandRequest,
    MissionClearAll,
    MissionItemInt,
    NavigatorStatus,
    ParamSet,
)
from robot.core import states
from robot.emergency_stop import UNREADABLE_ID
from robot.mission import stop_of
from robot.vehicle import Answer, RobotVehicle
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS

Items = tuple[MissionItemInt, ...]
ITEMS: Final = (MissionType.FENCE, MissionType.MISSION)


class PossibleValues:
    """The values that a setting may have after a restart, oldest first."""

    def __init__(self, first: object) -> None:
        self.possible = [repr(first)]

    def taken(self, value: object) -> None:
        """Add a value that the robot accepted."""
        self.possible.append(repr(value))

    def acknowledged(self, value: object) -> bool:
        """Drop older values; return False if the value was never accepted."""
        text = repr(value)
        if text not in self.possible:
            return False
        del self.possible[: self.possible.index(text)]
        return True


class PersistenceInvariants:
    """Tracks parameters, mission and fence from request to acknowledgement to restart."""

    def __init__(self, facts: RunState) -> None:
        self._facts = facts
        self._params: dict[str, PossibleValues] = {}
        self._items: defaultdict[int, PossibleValues] = defaultdict(lambda: PossibleValues(()))
        self._seen: dict[int, Items] = {}
        self._last_mission: Items = ()
        self._fence_lost = False

    def restored(self, vehicle: RobotVehicle) -> None:
        """Check the state that a restarted robot has restored."""
        for name, value in self._params.items():
            found = repr(float(getattr(vehicle.params, name)))
            if found not in value.possible:
                self._fail(name, found, value)
        for kind in ITEMS:
            items = self._seen[kind] = held(vehicle, kind)
            value = self._items[kind]
            if repr(items) not in value.possible and not self._shut_out(vehicle, kind, items):
                self._fail(kind.name.lower(), f"{len(items)} items", value)

    def _shut_out(self, vehicle: RobotVehicle, kind: int, items: Items) -> bool:
        """Return whether a mission is missing because it leaves the fence."""
        fence = vehicle.state.machine.fence
        if kind != MissionType.MISSION or fence is None or items:
            return False
        goals = [stop_of(item).goal for item in self._last_mission]
        return any(limits.outside_m(*fence, goal.x_m, goal.y_m) > 0.0 for goal in goals if goal)

    def _fail(self, name: str, found: str, value: PossibleValues) -> None:
        wanted = " or ".join(one[:60] for one in value.possible)
        self._facts.fail(
            "acknowledged change survives", f"{name} is {found} after a restart, not {wanted}"
        )

    def damaged(self, name: str) -> None:
        """Record that a file was damaged, so that its content is lost."""
        if name == "parameters":
            assert self._facts.robot is not None
            for param, value in self._params.items():
                value.taken(float(getattr(self._facts.robot.params, param)))
            return
        kind = MissionType[name.upper()]
        self._items[kind].taken(())
        self._fence_lost = self._fence_lost or kind == MissionType.FENCE

    def cycled(self, vehicle: RobotVehicle) -> None:
        """Check that a robot that lost its fence stays disarmed until it has a new one."""
        if self._fence_lost and vehicle.state.machine.vehicle == states.ACTIVE:
            self._facts.fail(
                "unreadable fence prevents arming",
                "the robot is armed, its fence was damaged on the disk",
            )

    def received(self, vehicle: RobotVehicle, request: Message) -> None:
        """Record the changes of an answered request."""
        if isinstance(request, ParamSet) and hasattr(vehicle.params, request.param_id):
            name = request.param_id
            value = float(getattr(vehicle.params, name))
            if name not in self._params:
                assert self._facts.robot is not None
                self._params[name] = PossibleValues(float(getattr(self._facts.robot.params, name)))
            self._params[name].taken(value)
        for kind in ITEMS:
            items = held(vehicle, kind)
            cleared = isinstance(request, MissionClearAll) and request.mission_type == kind
            if kind == MissionType.FENCE and (cleared or items is not self._seen.get(kind)):
                self._fence_lost = False
            if items is not self._seen.get(kind):
                self._seen[kind] = items
                if kind == MissionType.MISSION:
                    self._last_mission = items
                self._items[kind].taken(items)

    def ended(self, asked: OperatorRequest) -> None:
        """Check that an acknowledged change was made."""
        if not asked.answered or asked.action not in ("param", "fence", "fence off", "mission"):
            return
        first, second = asked.content
        if asked.action == "param":
            done = first in self._params and self._params[first].acknowledged(float(second))
        else:
            done = self._items[first].acknowledged(tuple(travelled(item) for item in second))
        if not done:
            self._facts.fail(
                "acknowledged request is executed", f"{asked.action} {first}: never accepted"
            )


def travelled(item: MissionItemInt) -> Message:
    """Return an item as it arrives: floats have 32 bits on the wire."""
    wire = wire_of(MissionItemInt)
    return wire.unpack(wire.pack(item))


def held(vehicle: RobotVehicle, kind: int) -> Items:
    """Return the items that a robot has."""
    transfers: Any = vehicle._transfers
    items: Items = transfers._held[kind].items
    return items


KEPT: Final = "stop survives a restart"


class StopInvariants:
    """Follows the stop from its press to the clear, over restarts of the robot."""

    def __init__(self, facts: RunState) -> None:
        self._facts = facts
        self._stop_ns: dict[tuple[str, int], int] = {}
        """Newest arrival of each stop, by the process that sent it and its id."""
        self._first_ns: dict[int, int] = {}
        """First arrival of each stop since the last release, by its id."""
        self._shown_ns: dict[int, int] = {}
        """When the status first showed each of them."""
        self._clear_ns: dict[tuple[str, int], int] = {}
        """Newest arrival of each request to clear, by operator and id."""
        self._latched = False
        self._seen_ns: int | None = None
        """When an operator has seen the stop that is latched."""
        self._promised = False
        """True if the stop must survive everything but a clear."""

    # Arrivals at the robot.

    def arrived(self, source: str, path: str, frame: bytes) -> None:
        """Note a frame or a request of an operator that has arrived."""
        if path.startswith((f"{STOP.path}/", STOP_SERVICE.path)):
            self._stop_arrived(source, frame)
        elif path.startswith(f"{COMMAND.path}/"):
            self._asked(source, operator_in(path.removeprefix(f"{COMMAND.path}/")), frame)

    def _stop_arrived(self, source: str, frame: bytes) -> None:
        message, now_ns = None, self._facts.now_ns
        with suppress(RemoteError):
            message = decode(frame).message
        number = message.request_id if isinstance(message, CommandRequest) else 0
        self._stop_ns[source, number] = now_ns
        self._first_ns.setdefault(number or UNREADABLE_ID, now_ns)

    def _asked(self, source: str, operator: str, frame: bytes) -> None:
        try:
            request = decode(frame).message
        except RemoteError:
            return
        if not isinstance(request, CommandRequest):
            return
        if request.command == Command.DO_FLIGHTTERMINATION:
            self._stop_arrived(source, frame)
        elif request.command == Command.SIDESTEP_CLEAR_EMERGENCY_STOP:
            self._clear_ns[operator, request.request_id] = self._facts.now_ns

    # The robot.

    def shown(self, frame: bytes) -> None:
        """Note a status that the robot publishes."""
        status = decode(frame).message
        if isinstance(status, NavigatorStatus) and status.vehicle == states.EMERGENCY_STOP:
            self._shown_ns.setdefault(status.stop_id, self._facts.now_ns)

    def received(
        self, vehicle: RobotVehicle, request: Message, answer: Answer, operator: str
    ) -> None:
        """Check an answered request."""
        stopped = vehicle.state.machine.vehicle == states.EMERGENCY_STOP
        if not isinstance(request, CommandRequest) or not accepted(answer):
            return
        if request.command == Command.DO_FLIGHTTERMINATION:
            self._latched = stopped
        elif request.command == Command.SIDESTEP_CLEAR_EMERGENCY_STOP and not stopped:
            if self._latched:
                self._released(operator, request)
            self._latched = self._promised = False
            self._seen_ns = None

    def _released(self, operator: str, request: CommandRequest) -> None:
        """Check that all other stops had arrived when the named one was shown and the clear came.

        A clear may name a stop of its own sender that no status has shown to it.
        """
        shown_ns = self._shown_ns.get(request.stop_id, NEVER)
        asked_ns = self._clear_ns.get((operator, request.request_id), NEVER)
        first_ns = (ns for number, ns in self._first_ns.items() if number != request.stop_id)
        newest_ns = max(first_ns, default=NEVER)
        if shown_ns < newest_ns:
            self._facts.fail(RELEASED, "released by a clear that names an earlier one")
        if asked_ns < newest_ns:
            self._facts.fail(RELEASED, "released by a clear that arrived before the newest stop")
        self._first_ns.clear()
        self._shown_ns.clear()

    def robot_started(self) -> None:
        """Forget a stop that need not be kept: the robot ended too soon after it."""
        if not self._promised:
            self._latched, self._seen_ns = False, None

    def restored(self, vehicle: RobotVehicle) -> None:
        """Check the state in which a robot starts."""
        self._latched = vehicle.state.machine.vehicle == states.EMERGENCY_STOP
        self._first_ns.clear()
        self._shown_ns.clear()
        if self._promised:
            self._facts.coverage.reached["stop kept over a restart"] += 1
        self.cycled(vehicle)

    def cycled(self, vehicle: RobotVehicle) -> None:
        """Check after each tick that a stop is latched until it is cleared."""
        facts, machine = self._facts, vehicle.state.machine
        if self._promised and machine.vehicle != states.EMERGENCY_STOP:
            facts.fail(KEPT, f"vehicle state {machine.vehicle}, and no operator has cleared it")
        if self._seen_ns is not None and facts.now_ns - self._seen_ns > limits.KEPT_NS:
            self._promised = self._promised or facts.disk_until_ns < self._seen_ns - limits.KEPT_NS

    # Operators.

    def ended(self, asked: OperatorRequest) -> None:
        """Note that an operator has seen its stop."""
        if asked.action == "stop" and asked.answered and self._latched and self._seen_ns is None:
            self._seen_ns = asked.ended_ns

    def judge(self) -> None:
        """Check that each stop is acknowledged in time, also while the plant's clock stands."""
        facts = self._facts
        if facts.robot is None or not facts.robot.runs:
            return
        sound_ns = max(facts.disturbed_until_ns, facts.impaired_until_ns, facts.started_ns)
        for asked in facts.history.pressed:
            took_ns = facts.now_ns - max(asked.asked_ns, sound_ns)
            if asked.ended_ns is None and took_ns > self._limit_ns(asked):
                facts.fail(
                    "stop is acknowledged in time",
                    f"{asked.operator} has none {took_ns // NS_PER_MS} ms after its press",
                )

    def _limit_ns(self, asked: OperatorRequest) -> int:
        """Return the limit; a stop among others may be acknowledged by a lasting one instead.

        Others are also those of the same operator, where a press tells its id.
        """
        if asked.operator.startswith("client"):
            return limits.CLIENT_ACKNOWLEDGED_NS
        known = asked.content
        others = (
            ns
            for (name, number), ns in self._stop_ns.items()
            if name != asked.operator or (known and number not in known)
        )
        is_alone = max(others, default=NEVER) < asked.asked_ns - limits.PERIOD_NS
        return limits.ACKNOWLEDGED_NS if is_alone else limits.ACKNOWLEDGED_AMONG_OTHERS_NS
