"""A scripted robot: a test sets its answers and messages, its lease and its missions."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from math import nan
from typing import Self

from checks.harness.messages import make
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.bus.services import ServiceRequest
from protocol.topic import person_of
from protocol.topics import (
    COMMAND,
    HEARTBEAT,
    LEASE,
    LEASE_SERVICE,
    MISSION,
    MISSION_SERVICE,
    ODOMETRY,
    OPERATOR,
    PARAMETER,
    PARAMETERS,
    STATUS,
    TELEOP,
    Role,
)
from protocol.wire.codec import decode
from protocol.wire.enums import (
    AckResult,
    Command,
    GoalState,
    LeaseAction,
    MissionState,
    MissionType,
    Mode,
    Vehicle,
)
from protocol.wire.limits import NO_ITEM
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    Heartbeat,
    LeaseRequest,
    LeaseStatus,
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    MissionStatus,
    MissionVerdict,
    NavigatorStatus,
    ParamSet,
    ParamValue,
    PlanarOdometry,
    Teleop,
)
from protocol.wire.reasons import Reason
from robot.commands import acknowledge


class PlayedDesk:
    """Grants the lease to the first person and accepts missions that `verdict` does not refuse.

    `held` is the identity and the name of the program that took the lease; `programs` are those of
    its person that have it. `drive` is the request_id of the newest drive, and who began it.
    `lost`: how many of the coming mission frames stay unanswered.
    """

    def __init__(self, bus: Bus) -> None:
        self.held: tuple[str, str] | None = None
        self.programs: set[str] = set()
        self.drive: tuple[int, str] = (0, "")
        self.actions: list[LeaseRequest] = []
        self.frames: list[Message] = []
        self.kept: dict[int, list[MissionItemInt]] = {kind: [] for kind in MissionType}
        self.verdict = (Reason.NONE, NO_ITEM)
        self.lost = 0
        self.status = MissionState.READY
        self._expected: dict[int, int] = {}
        self._incoming: dict[int, list[MissionItemInt]] = {}
        self._lease = bus.publisher(LEASE)
        self._mission = bus.publisher(MISSION)
        bus.serve(LEASE_SERVICE, self._judge)
        bus.serve(MISSION_SERVICE, self._transfer)

    def speak(self, time_ns: int) -> None:
        holder, name = self.held or ("", "")
        self._lease.put(
            LeaseStatus(
                time_ns=time_ns,
                lapses_ms=2500 if self.held else 0,
                held=int(self.held is not None),
                holder=holder,
                name=name,
                drive_id=self.drive[0],
                driver=self.drive[1],
            )
        )
        count = len(self.kept[MissionType.MISSION])
        self._mission.put(
            make(
                MissionStatus,
                time_ns=time_ns,
                mission_id=1 if count else 0,
                count=count,
                state=self.status if count else MissionState.NONE,
            )
        )

    def _judge(self, asked: ServiceRequest) -> None:
        request = asked.message
        assert isinstance(request, LeaseRequest)
        if request not in self.actions:  # it is repeated when the reply is late
            self.actions.append(request)
        person = person_of(asked.operator)
        others = self.held is not None and person_of(self.held[0]) != person
        refused = others and request.action != LeaseAction.SEIZE
        if not refused:
            self._change(request, asked.operator)
        result = AckResult.DENIED if refused else AckResult.ACCEPTED
        reason = Reason.LEASE_HELD if refused else Reason.NONE
        asked.reply(CommandAck(command=0, result=result, result_param2=reason))

    def _change(self, request: LeaseRequest, operator: str) -> None:
        if request.action in (LeaseAction.TAKE, LeaseAction.SEIZE):
            others = self.held is not None and person_of(self.held[0]) != person_of(operator)
            self.programs = {operator} if others else self.programs | {operator}
            self.held = (operator, request.name)
            return
        self.programs.discard(operator)
        if request.action == LeaseAction.RELEASE or not self.programs:
            self.held, self.programs = None, set()

    def _transfer(self, asked: ServiceRequest) -> None:
        assert asked.message is not None
        self.frames.append(asked.message)
        if self.lost:
            self.lost -= 1
            asked.drop()
            return
        asked.reply(self._answer(asked.message))

    def _answer(self, frame: Message) -> Message:
        if isinstance(frame, MissionClearAll):
            self.kept[frame.mission_type] = []
            return self._verdict(frame.mission_type)
        if isinstance(frame, MissionRequestList):
            kept = self.kept[frame.mission_type]
            return MissionCount(count=len(kept), mission_type=frame.mission_type)
        if isinstance(frame, MissionRequestInt):
            return self.kept[frame.mission_type][frame.seq]
        assert isinstance(frame, MissionCount | MissionItemInt)
        return self._taken(frame)

    def _taken(self, frame: MissionCount | MissionItemInt) -> Message:
        kind = frame.mission_type
        if isinstance(frame, MissionCount):
            self._expected[kind], self._incoming[kind] = frame.count, []
        elif frame.seq == len(self._incoming[kind]):
            self._incoming[kind].append(frame)
        if len(self._incoming[kind]) < self._expected[kind]:
            return MissionRequestInt(seq=len(self._incoming[kind]), mission_type=kind)
        if self.verdict[0] is Reason.NONE:
            self.kept[kind] = self._incoming[kind]
        return self._verdict(kind)

    def _verdict(self, kind: int) -> MissionVerdict:
        reason, item = self.verdict
        return MissionVerdict(mission_id=1, item=item, reason=reason, mission_type=kind)


Say = Callable[..., tuple[int, str, str]]
"""Runs a verb: exit code, standard output, standard error."""

BEAT = make(Heartbeat)
PARAMETER_LIST = b"""[
 {"name": "d_obs_m", "value": 0.4, "default": 0.3, "unit": "m", "minimum": 0.05, "maximum": 3.0,
  "integer": false, "doc": "zone", "saved": %s},
 {"name": "side", "value": 1, "default": 1, "unit": "", "minimum": -1, "maximum": 1,
  "integer": true, "doc": "side"}]"""
SAYS_SAVED = {True: b"true", False: b"false", None: b"null"}


class PlayedRobot:
    """Publishes twenty times a second from its own thread, until it is closed."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.asked: list[Message] = []
        self.answers: list[Reason | None] = []
        self._replies: dict[int, CommandAck] = {}
        self.beats = 0
        self.goal_id = 0
        self.goal = GoalState.NONE
        self.goal_reason = Reason.NONE
        self.vehicle = Vehicle.STANDBY
        self.mode = Mode.GUIDED
        self.after_goal: Callable[[], None] = lambda: None
        self.stop_id = 0
        self.deaf = False
        """Whether it takes no notice of emergency stops."""
        self.saves: bool | None = True
        self.saving = 0
        """So many times it says of a parameter that it is being saved."""
        self.stale: NavigatorStatus | None = None
        """What it says for as long as this is there, whatever has happened since."""
        self._time_ns = 0
        self._stop = threading.Event()
        self._status = bus.publisher(STATUS)
        self._heart = bus.publisher(HEARTBEAT)
        self._pose = bus.publisher(ODOMETRY)
        self.pose: tuple[float, float, float] | None = None
        """Where it says it is, in metres and radians; None: it does not say."""
        self.desk = PlayedDesk(bus)
        self.driven: list[Teleop] = []
        self._thread = threading.Thread(target=self._speak, daemon=True)

    def __enter__(self) -> Self:
        self.bus.serve_clock()
        self.bus.serve_stop(self._pressed, ServiceRequest.drop)
        self.bus.serve(COMMAND, self._command)
        self.bus.serve(PARAMETER, self._parameter)
        self.bus.serve(PARAMETERS, lambda asked: self._list(asked))
        self.bus.stream(OPERATOR, self._beaten)
        self.bus.stream(TELEOP, self._steered)
        self.bus.announce()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.fall_silent()

    def fall_silent(self) -> None:
        """Stop the loop; keep the process and its liveliness token."""
        self._stop.set()
        self._thread.join()

    def reach_goals(self) -> None:
        """Be at each coming goal at once."""
        self.after_goal = partial(setattr, self, "goal", GoalState.REACHED)

    def _speak(self) -> None:
        while not self._stop.wait(0.02):
            self._time_ns += 50_000_000
            self._heart.put(BEAT)
            self._status.put(self.stale or self.status())
            self.desk.speak(self._time_ns)
            if self.pose is not None:
                self._pose.put(pose_of(self.pose, self._time_ns))

    def status(self) -> NavigatorStatus:
        over = self.goal >= GoalState.REACHED
        return make(
            NavigatorStatus,
            time_ns=self._time_ns,
            goal_started_ns=1 if self.goal_id else 0,
            goal_ended_ns=self._time_ns if over else 0,
            goal_id=self.goal_id,
            stop_id=self.stop_id,
            goal_heading_rad=nan,
            goal_distance_m=1.0,
            vehicle=self.vehicle,
            mode=self.mode,
            goal=self.goal,
            goal_reason=self.goal_reason,
        )

    def _beaten(self, _key: str, _frame: bytes, _at_ns: int) -> None:
        self.beats += 1

    def _steered(self, _key: str, frame: bytes, _at_ns: int) -> None:
        message = decode(frame).message
        assert isinstance(message, Teleop)
        self.driven.append(message)

    def _command(self, asked: ServiceRequest) -> None:
        message = asked.message
        assert isinstance(message, CommandRequest | GoalRequest)
        if message.request_id in self._replies:  # the reply was late, as on a busy machine
            asked.reply(self._replies[message.request_id])
            return
        self.asked.append(message)
        reason = self.answers.pop(0) if self.answers else Reason.NONE
        if reason is None:
            asked.drop()
            return
        if reason is Reason.NONE and self._is_newer_stop(message):
            reason = Reason.NEWER_STOP
        if reason is Reason.NONE and self._is_over(message):
            reason = Reason.ALREADY_OVER
        if reason is Reason.NONE:
            self._act(message)
            if begins_drive(message):
                self.desk.drive = message.request_id, "anna"
        reply = acknowledge(message, reason)
        if reason is Reason.NONE:
            self._replies[message.request_id] = reply
        asked.reply(reply)

    def _pressed(self, _operator: str, frame: bytes) -> None:
        """Store the first emergency stop that arrives by either of its two paths."""
        message = decode(frame).message
        assert isinstance(message, CommandRequest)
        if self.deaf:
            return
        if self.stop_id != message.request_id:
            self.asked.append(message)
        self.vehicle, self.stop_id = Vehicle.EMERGENCY_STOP, message.request_id

    def _is_newer_stop(self, message: CommandRequest | GoalRequest) -> bool:
        """Return whether a release names another stop than the one that is latched."""
        if isinstance(message, GoalRequest) or self.vehicle is not Vehicle.EMERGENCY_STOP:
            return False
        is_clear = message.command == Command.SIDESTEP_CLEAR_EMERGENCY_STOP
        return is_clear and message.stop_id != self.stop_id

    def _is_over(self, message: CommandRequest | GoalRequest) -> bool:
        """Return whether a clean-up names neither the present goal nor the newest drive."""
        ends_id = 0 if isinstance(message, GoalRequest) else message.ends_id
        return ends_id not in (0, self.goal_id, self.desk.drive[0])

    def _act(self, message: CommandRequest | GoalRequest) -> None:
        if isinstance(message, GoalRequest):
            self.goal_id, self.goal = message.request_id, GoalState.DRIVING
            self.mode = Mode(message.mode)
            self.after_goal()
        elif message.command == Command.COMPONENT_ARM_DISARM:
            self.vehicle = Vehicle.ACTIVE if message.param1 else Vehicle.STANDBY
        elif message.command == Command.SIDESTEP_CLEAR_EMERGENCY_STOP:
            self.vehicle = Vehicle.STANDBY
        elif message.command == Command.DO_SET_MODE:
            self.mode = Mode(int(message.param2))
            if self.mode is Mode.MANUAL and self.goal == GoalState.DRIVING:
                self.goal, self.goal_reason = GoalState.ABORTED, Reason.BY_OPERATOR
        elif message.command == Command.SIDESTEP_ABORT_GOAL:
            self.goal, self.goal_reason = GoalState.ABORTED, Reason.BY_OPERATOR

    def _parameter(self, asked: ServiceRequest) -> None:
        message = asked.message
        assert isinstance(message, ParamSet)
        if message.param_id != "d_obs_m":
            reason = Reason.UNKNOWN_PARAMETER
            asked.reply(CommandAck(command=0, result=AckResult.DENIED, result_param2=reason))
            return
        value = message.param_value
        if self.saving:
            self.saving -= 1
            asked.reply(CommandAck(command=0, result=AckResult.IN_PROGRESS))
            return
        asked.reply(make(ParamValue, param_id="d_obs_m", param_value=value, param_count=2))

    def _list(self, asked: ServiceRequest) -> None:
        asked.reply(PARAMETER_LIST % SAYS_SAVED[self.saves])

    @property
    def commands(self) -> list[int]:
        """MAV_CMD of what was asked; a goal counts as DO_REPOSITION."""
        return [
            message.command if isinstance(message, CommandRequest) else Command.DO_REPOSITION
            for message in self.asked
        ]


def begins_drive(message: CommandRequest | GoalRequest) -> bool:
    """Return whether a request begins a goal, a drive by hand or a mission."""
    if isinstance(message, GoalRequest) or message.command == Command.MISSION_START:
        return True
    return message.command == Command.DO_SET_MODE and message.param2 == Mode.MANUAL


def pose_of(pose: tuple[float, float, float], time_ns: int) -> PlanarOdometry:
    """Standing there, and sure of it."""
    x_m, y_m, heading_rad = pose
    return make(PlanarOdometry, time_ns=time_ns, x_m=x_m, y_m=y_m, heading_rad=heading_rad)


@contextmanager
def played(name: str = "r1") -> Iterator[tuple[PlayedRobot, str]]:
    """Start a robot; yield it with the endpoint at which it listens."""
    network = Network(mode="peer", listen=("tcp/127.0.0.1:0",))
    with open_bus(network, Role.ROBOT, name) as bus, PlayedRobot(bus) as robot:
        yield robot, bus.locator()
