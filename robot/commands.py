"""Handle the requests of operators, and their manual driving with a dead-man switch.

A repeated request is acted on only once. Steering lasts only while frames arrive.
"""

from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from math import isfinite
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias, TypeGuard

from protocol.topic import person_of
from protocol.wire.enums import AckResult, Command, Mode
from protocol.wire.limits import MAX_TELEOP_TTL_MS
from protocol.wire.message import Message, wire_of
from protocol.wire.messages import CommandAck, CommandRequest, GoalRequest, Teleop
from robot.core import modes, reasons, states
from robot.core.modes import Machine
from robot.core.values import Twist, goal_of, twist_of
from robot.hosting import Core
from robot.mission import Mission
from runtime.units import NS_PER_MS

MAX_OPERATORS: Final = 64
MAX_ANSWERS: Final = 32
"""Answers kept for each operator; the operators with the newest requests are kept."""

MAX_STOPS: Final = 256
"""Ids of stops of which a late copy is known not to be new."""

RESTART: Final = 1.0
"""Parameter 1 of PREFLIGHT_REBOOT_SHUTDOWN that restarts the robot process."""

CONTINUING: Final = (Command.DO_SET_MISSION_CURRENT,)
"""Commands that lead a mission on, which stays that of its driver."""

CommandOrGoal: TypeAlias = CommandRequest | GoalRequest


class Commands:
    """Applies requests to the core and to the mission.

    `goal_id` is the id of the request that set the current goal; goals of a mission have the id of
    the request that started it. `drive_id` and `begun_by` are the request that began the newest
    goal or manual drive, and the program that sent it. `driver` is the program that has the robot
    move: in GUIDED and MANUAL the robot stops when this one is lost; empty if any may.
    `is_there(operator, now_ms)` returns whether a program sends heartbeats. `restarts`: an operator
    has asked for a restart of the process.
    """

    def __init__(
        self,
        core: Core,
        mission: Mission,
        is_there: Callable[[str, int], bool] = lambda _operator, _now_ms: True,
    ) -> None:
        self._core = core
        self._machine = core.state.machine
        self._mission = mission
        self._is_there = is_there
        self._answers = AnswerCache()
        self.goal_id = self.drive_id = 0
        self.begun_by = self.driver = ""
        self._stop_ids: deque[int] = deque([0], MAX_STOPS)
        self._shown_id = 0
        self.restarts = False

    @property
    def stop_id(self) -> int:
        """The id of the newest emergency stop, 0 before the first; a later copy is none."""
        return self._stop_ids[-1]

    def take_shown_stop(self) -> int:
        """Return the stop_id of the next status: that of a copy since the last one, or the newest.

        So whoever repeats a stop sees it acknowledged, also behind a later one. A clear must name
        the newest nevertheless.
        """
        shown, self._shown_id = self._shown_id, self.stop_id
        return shown

    def is_stopped_by(self, request_id: int) -> bool:
        """Return whether the emergency stop with this id is latched."""
        stopped = self._machine.vehicle == states.EMERGENCY_STOP
        return stopped and request_id in self._stop_ids

    def receive(self, request: CommandOrGoal, now_ms: int, operator: str = "") -> CommandAck:
        """Act on a request and return the answer, which contains a reason.

        A repeated request gets its earlier answer. A different request with the same id is refused.
        An emergency stop is acted on every time.
        """
        if is_stop(request):
            self._note_stop(request.request_id)
            return acknowledge(request, self._handle(request, now_ms))
        known = self._answers.find(operator, request)
        if known is not None:
            return known
        answer = acknowledge(request, self._act(request, now_ms, operator))
        self._answers.keep(operator, request, answer)
        return answer

    def _note_stop(self, request_id: int) -> None:
        """Take a stop for the newest one, unless it is a copy of one that is latched.

        A clear that names that one may have been sent before later ones.
        """
        if self._machine.vehicle != states.EMERGENCY_STOP:
            self._stop_ids.clear()
        if request_id not in self._stop_ids:
            self._stop_ids.append(request_id)
        self._shown_id = request_id

    def _act(self, request: CommandOrGoal, now_ms: int, operator: str) -> int:
        machine = self._machine
        serial, mode = machine.serial, machine.mode
        # Who resumes the drive of an own program leaves it to that one while it is there.
        is_own = bool(self.driver) and person_of(self.driver) == person_of(operator)
        is_led = resumes(request) and is_own and self._is_there(self.driver, now_ms)
        # Without any operator the core itself refuses, and shows it in the state of the goal.
        is_absent = machine.operator and not is_led and not self._is_there(operator, now_ms)
        if is_absent and needs_operator(request, machine):
            return reasons.NO_OPERATOR
        reason = self._handle(request, now_ms)
        is_new = machine.serial != serial
        if is_new:
            self.goal_id = request.request_id
        if is_new or (reason == reasons.OK and is_manual(request)):
            self.drive_id, self.begun_by = request.request_id, operator
        elif machine.mode == mode or machine.mode == states.HOLD:
            return reason
        leads_on = isinstance(request, CommandRequest) and request.command in CONTINUING
        if not (is_led or leads_on):
            self.driver = operator
        return reason

    def _is_over(self, request: CommandRequest) -> bool:
        """Return whether the goal or drive that a clean-up names is no longer there."""
        machine = self._machine
        if machine.mode == states.MANUAL:
            return request.ends_id != self.drive_id
        is_live = modes.goal_is_active(machine) or self._mission.active
        return request.ends_id != self.goal_id or not is_live

    def _handle(self, request: CommandOrGoal, now_ms: int) -> int:
        if isinstance(request, GoalRequest):
            return self._goto(request, now_ms)
        if request.ends_id and self._is_over(request):
            return reasons.ALREADY_OVER
        row = HANDLERS.get(request.command)
        if row is None:
            return reasons.UNKNOWN_COMMAND
        if not all(isfinite(getattr(request, name)) for name in row.uses):
            return reasons.PARAMETER_OUT_OF_RANGE
        return row.handler(self, request, now_ms)

    def _goto(self, request: GoalRequest, now_ms: int) -> int:
        goal = goal_of(
            request.x_mm,
            request.y_mm,
            request.heading_urad,
            request.heading_free,
            request.position_tolerance_mm,
            request.heading_tolerance_urad,
        )
        from_robot = request.from_robot != 0
        return self._core.drive_to(goal, request.mode, now_ms, from_robot=from_robot)

    def _by_core(self, request: CommandRequest, now_ms: int) -> int:
        return self._core.command(request, now_ms)

    def _pause_continue(self, request: CommandRequest, now_ms: int) -> int:
        if request.param1 and self._mission.active:
            return self._mission.resume(now_ms)
        return self._core.command(request, now_ms)

    def _abort(self, request: CommandRequest, now_ms: int) -> int:
        if self._mission.active:
            return self._mission.abort(now_ms)
        return self._core.command(request, now_ms)

    def _set_pose(self, request: CommandRequest, now_ms: int) -> int:
        if self._mission.active:
            return reasons.DRIVING
        return self._core.command(request, now_ms)

    def _start_mission(self, request: CommandRequest, now_ms: int) -> int:
        return self._mission.start(int(request.param1), now_ms)

    def _jump(self, request: CommandRequest, now_ms: int) -> int:
        return self._mission.jump(int(request.param1), now_ms)

    def _restart(self, request: CommandRequest, now_ms: int) -> int:
        """Ask for a restart; a robot that is armed or in an emergency stop refuses."""
        if request.param1 != RESTART:
            return reasons.PARAMETER_OUT_OF_RANGE
        if self._machine.vehicle == states.EMERGENCY_STOP:
            return reasons.EMERGENCY_STOPPED
        if self._machine.vehicle == states.ACTIVE:
            return reasons.ARMED
        self.restarts = True
        return reasons.OK


class AnswerCache:
    """The newest requests of each operator with their answers."""

    def __init__(self) -> None:
        self._of: OrderedDict[str, OrderedDict[int, tuple[CommandOrGoal, CommandAck]]] = (
            OrderedDict()
        )

    def find(self, operator: str, request: CommandOrGoal) -> CommandAck | None:
        """Return the earlier answer to this request, or a refusal if another one had its id."""
        of_operator = self._of.get(operator)
        kept = None if of_operator is None else of_operator.get(request.request_id)
        if kept is None:
            return None
        same = wire_form(kept[0]) == wire_form(request)
        return kept[1] if same else acknowledge(request, reasons.ID_REUSED)

    def keep(self, operator: str, request: CommandOrGoal, answer: CommandAck) -> None:
        """Store the answer to a request and drop the oldest ones beyond the limits."""
        kept = self._of.setdefault(operator, OrderedDict())
        self._of.move_to_end(operator)
        kept[request.request_id] = request, answer
        if len(kept) > MAX_ANSWERS:
            kept.popitem(last=False)
        if len(self._of) > MAX_OPERATORS:
            self._of.popitem(last=False)


def wire_form(request: CommandOrGoal) -> tuple[type[Message], bytes]:
    """Return the type and bytes of a request, by which NaN compares equal to NaN."""
    return type(request), wire_of(type(request)).pack(request)


def is_stop(request: Message | None) -> bool:
    """Return whether a request is an emergency stop."""
    return isinstance(request, CommandRequest) and request.command == Command.DO_FLIGHTTERMINATION


def is_arm(request: Message | None) -> bool:
    """Return whether a request arms."""
    return (
        isinstance(request, CommandRequest)
        and request.command == Command.COMPONENT_ARM_DISARM
        and request.param1 != 0.0
    )


def is_clear(request: Message | None) -> TypeGuard[CommandRequest]:
    """Return whether a request releases the emergency stop."""
    return (
        isinstance(request, CommandRequest)
        and request.command == Command.SIDESTEP_CLEAR_EMERGENCY_STOP
    )


def is_manual(request: CommandOrGoal) -> bool:
    """Return whether a request begins a drive by hand."""
    return (
        isinstance(request, CommandRequest)
        and request.command == Command.DO_SET_MODE
        and request.param2 == Mode.MANUAL
    )


def needs_operator(request: CommandOrGoal, machine: Machine) -> bool:
    """Return whether the robot moves on this request only while its sender is there."""
    if isinstance(request, GoalRequest):
        return request.mode == Mode.GUIDED
    if request.command == Command.DO_SET_MODE:
        return request.param2 in (Mode.GUIDED, Mode.MANUAL)
    is_held = machine.mode == states.HOLD and machine.resume_mode == states.GUIDED
    return is_held and resumes(request)


def resumes(request: CommandOrGoal) -> bool:
    """Return whether a request continues what was held."""
    return (
        isinstance(request, CommandRequest)
        and request.command == Command.DO_PAUSE_CONTINUE
        and request.param1 != 0.0
    )


def acknowledge(request: CommandOrGoal, reason: int) -> CommandAck:
    """Return the answer with a reason; a goal is acknowledged as DO_REPOSITION."""
    command = Command.DO_REPOSITION if isinstance(request, GoalRequest) else request.command
    return ack(command, reason)


def ack(command: int, reason: int) -> CommandAck:
    """Return a COMMAND_ACK for a command and a reason."""
    return CommandAck(
        command=command,
        result=result_of(reason),
        progress=0,
        result_param2=reason,
        target_system=0,
        target_component=0,
    )


def result_of(reason: int) -> int:
    """Return the MAV_RESULT that matches a reason."""
    if reason == reasons.OK:
        return AckResult.ACCEPTED
    return AckResult.UNSUPPORTED if reason == reasons.UNKNOWN_COMMAND else AckResult.DENIED


Handler = Callable[[Commands, CommandRequest, int], int]


class CommandRow(NamedTuple):
    """A command's handler, and the parameters it uses.

    The other parameters may have any value: MAVLink sets unused ones to NaN.
    """

    handler: Handler
    uses: tuple[str, ...] = ()


HANDLERS: Final[Mapping[int, CommandRow]] = MappingProxyType(
    {
        Command.COMPONENT_ARM_DISARM: CommandRow(Commands._by_core, ("param1",)),
        Command.DO_SET_MODE: CommandRow(Commands._by_core, ("param2",)),
        Command.DO_PAUSE_CONTINUE: CommandRow(Commands._pause_continue, ("param1",)),
        Command.DO_FLIGHTTERMINATION: CommandRow(Commands._by_core),
        Command.NAV_RETURN_TO_LAUNCH: CommandRow(Commands._by_core),
        Command.MISSION_START: CommandRow(Commands._start_mission, ("param1",)),
        Command.DO_SET_MISSION_CURRENT: CommandRow(Commands._jump, ("param1",)),
        Command.PREFLIGHT_REBOOT_SHUTDOWN: CommandRow(Commands._restart, ("param1",)),
        Command.SIDESTEP_SET_NAVIGATOR: CommandRow(Commands._by_core, ("param1", "param2")),
        Command.SIDESTEP_SET_POSE: CommandRow(Commands._set_pose, ("param1", "param2")),
        Command.SIDESTEP_ABORT_GOAL: CommandRow(Commands._abort),
        Command.SIDESTEP_CLEAR_EMERGENCY_STOP: CommandRow(Commands._by_core),
    }
)


class TeleopInput:
    """The newest teleop frame and its expiry; a frame with too long a validity is ignored."""

    def __init__(self) -> None:
        self._newest: Teleop | None = None
        self._until_ns = 0
        self._refused_ms = 0

    def receive(self, teleop: Teleop, sent_ns: int) -> str:
        """Take a frame sent at `sent_ns`; return why it is ignored, once for each new cause."""
        ttl_ms = teleop.ttl_ms
        if ttl_ms > MAX_TELEOP_TTL_MS:
            again, self._refused_ms = ttl_ms == self._refused_ms, ttl_ms
            words = (
                f"teleop ignored: valid for {ttl_ms} ms, at most {MAX_TELEOP_TTL_MS} are allowed"
            )
            return "" if again else words
        self._newest = teleop
        self._until_ns = sent_ns + ttl_ms * NS_PER_MS
        self._refused_ms = 0
        return ""

    def clear(self) -> None:
        """Drop the frame, because another operator takes over."""
        self._newest = None

    def newest(self, now_ns: int) -> Teleop | None:
        """Return the frame in force, or None after its expiry."""
        return self._newest if now_ns < self._until_ns else None


def operator_twist(teleop: Teleop | None) -> Twist | None:
    """Return the twist the operator commands, or None without a frame in force."""
    return None if teleop is None else twist_of(teleop.speed_mm_s, teleop.yaw_rate_mrad_s)
