"""Handle the requests of operators, and their manual driving with a dead-man switch.

`TABLE` holds what is known of each command, to all who ask. A repeated request is acted on only
once. Steering lasts only while frames arrive.
"""

from collections import OrderedDict, deque
from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias

from protocol.topic import person_of
from protocol.wire.enums import AckResult, Command, Mode
from protocol.wire.limits import MAX_TELEOP_TTL_MS
from protocol.wire.message import Message, wire_of
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    MissionRequestInt,
    MissionRequestList,
    ParamRequestRead,
    Teleop,
)
from robot.core import modes, reasons, states
from robot.core.values import Goal, Twist, goal_of, twist_of
from robot.hosting import Core
from robot.lease import Asker
from robot.mission import DEFAULT, LEAST_SPEED_M_S, UNCHANGED, MissionExecutor, Stoppers
from runtime.cli.terminal import printable
from runtime.units import NS_PER_MS

MAX_OPERATORS: Final = 64
MAX_ANSWERS: Final = 32
"""Answers kept for each operator; the operators with the newest requests are kept."""

MAX_STOPS: Final = 256
"""Ids of stops of which a late copy is known not to be new."""

PRESENT_MS: Final = 600
"""Age of the newest of three heartbeats: a drive is left to another program that is no more silent.

It may have been killed since the last one.
"""

FOR_GOAL: Final = 1.0
"""Parameter 1 of DO_CHANGE_SPEED that limits the speed of the present goal alone."""

RESTART: Final = 1.0
"""Parameter 1 of PREFLIGHT_REBOOT_SHUTDOWN that restarts the robot process."""

READ_ONLY: Final = (ParamRequestRead, MissionRequestList, MissionRequestInt)
CommandOrGoal: TypeAlias = CommandRequest | GoalRequest


class Commands:
    """Applies requests to the core and to the mission.

    `goal_id` is the id of the request that set the current goal; goals of a mission have the id of
    the request that started it. `drive_id` and `begun_by` are the request that began the newest
    goal or manual drive, and who sent it. `led_by` has the robot move: in GUIDED and MANUAL the
    robot stops when its program, the `driver`, is lost; empty if any may.
    `is_there(operator, now_ms, within_ms)` returns whether a program sends heartbeats, and has sent
    the last one in this time, if one is given. `restarts`: an operator has asked for a restart of
    the process. `stoppers` are the names of others that have stopped what `begun_by` began.
    """

    def __init__(
        self,
        core: Core,
        mission: MissionExecutor,
        is_there: Callable[[str, int, int | None], bool] = lambda *_: True,
    ) -> None:
        self._core = core
        self._machine = core.state.machine
        self._mission = mission
        self._is_there = is_there
        self._answers = AnswerCache()
        self.goal_id = self.drive_id = 0
        self.begun_by = self.led_by = Asker()
        self._asking = ""
        self.stoppers = Stoppers()
        self._hosted: Sequence[Commands] = (self,)
        self._stop_ids: deque[int] = deque([0], MAX_STOPS)
        self._shown_id = 0
        self.restarts = False

    def share_process(self, robots: "Sequence[Commands]") -> None:
        """Name all robots of this process, which end with it: a restart must find each at rest."""
        self._hosted = robots

    @property
    def driver(self) -> str:
        """The identity of the program that has the robot move; empty if any may."""
        return self.led_by.operator

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
        kind, machine, self._asking = kind_of(request), self._machine, operator
        if kind.is_emergency_stop:
            self._note_stop(request.request_id)
        else:
            known = self._answers.find(operator, request)
            if known is not None:
                return known
        begun, mode = (machine.serial, self._mission.starts), machine.mode
        had_goal, on_mission = modes.goal_is_active(machine), self._mission.active
        goes_on = kind.resumes and self._is_attended
        vehicle = machine.vehicle
        was_by_hand = vehicle == states.ACTIVE and mode == states.MANUAL
        leader = self._leader(kind, now_ms, operator)
        reason = self._refusal(request, kind, now_ms, leader)
        if reason == reasons.OK:
            if isinstance(request, GoalRequest):
                from_robot = request.from_robot != 0
                goal = goal_in(request)
                reason = self._core.drive_to(goal, request.mode, now_ms, from_robot=from_robot)
            else:
                done = None if kind.by_host is None else kind.by_host(self, request, now_ms)
                reason = self._core.command(request, now_ms) if done is None else done
        is_new = (machine.serial, self._mission.starts) != begun
        self._mission.speed.follow(operator if is_new else "")
        asker = Asker(operator, printable(request.sender))
        other = "" if asker.party == self.begun_by.party else asker.label
        self._note_stopper(other, had_goal and not is_new, is_new, mode, on_mission)
        if was_by_hand and machine.vehicle == states.STANDBY:
            self.stoppers = self.stoppers._replace(hold=other)
        if is_new:
            self.goal_id = request.request_id
        begins = is_new or (reason == reasons.OK and kind.by_hand)
        if begins:
            self.drive_id, self.begun_by = request.request_id, asker
        goes_on = goes_on and reason == reasons.OK
        if (begins or goes_on or machine.mode not in (mode, states.HOLD)) and not kind.leads_on:
            self.led_by = asker if leader == operator else self.led_by
        if reason == reasons.OK:
            reason = self._note_on(kind, vehicle)
        answer = acknowledge(request, reason)
        if not kind.is_emergency_stop:
            self._answers.keep(operator, request, answer)
        return answer

    def _note_stopper(
        self, other: str, had_goal: bool, is_new: bool, mode: int, on_mission: bool
    ) -> None:
        """Note what a request has stopped; `other` sent it, if another one began that."""
        machine, mission, by = self._machine, self._mission, self.stoppers
        if is_new or (had_goal and not modes.goal_is_active(machine)):
            by = by._replace(goal="" if is_new else other)
        if machine.mode != states.HOLD or mode != states.HOLD:
            by = by._replace(hold=other if machine.mode == states.HOLD else "")
        if on_mission and not (mission.active and mission.reason_to_end() == reasons.OK):
            by = by._replace(mission=other)
        elif mission.active:
            by = by._replace(mission="")
        self.stoppers = by

    def _note_on(self, kind: "CommandKind", before: int) -> int:
        """Return the reason why an accepted request has changed nothing, or 0.

        `before` is the vehicle state in which it found the robot.
        """
        if kind.is_clear and before != states.EMERGENCY_STOP:
            return reasons.NOTHING_LATCHED
        if (kind.is_arm or kind.is_disarm) and self._machine.vehicle == before:
            return reasons.NOTHING_CHANGED
        has_goal = modes.goal_is_active(self._machine) or self._mission.active
        return reasons.NOTHING_KEPT if kind.keeps_goal and not has_goal else reasons.OK

    def _note_stop(self, request_id: int) -> None:
        """Take a stop for the newest one, unless it is a copy of one that is latched.

        A clear that names that one may have been sent before later ones.
        """
        if self._machine.vehicle != states.EMERGENCY_STOP:
            self._stop_ids.clear()
        if request_id not in self._stop_ids:
            self._stop_ids.append(request_id)
        self._shown_id = request_id

    def _leader(self, kind: "CommandKind", now_ms: int, operator: str) -> str:
        """Return the program that has the robot move if this request makes it move.

        Who resumes the drive of an own program, or one that goes on, leaves it to its program while
        that is there.
        """
        is_own = person_of(self.driver) == person_of(operator)
        goes_on = self._is_attended and self._machine.mode == states.GUIDED
        may_lead = bool(self.driver) and kind.resumes and (is_own or goes_on)
        is_led = may_lead and self._is_there(self.driver, now_ms, PRESENT_MS)
        return self.driver if is_led else operator

    @property
    def _is_attended(self) -> bool:
        """True while a goal is driven to, or held, in GUIDED: its program must be there."""
        machine = self._machine
        mode = machine.resume_mode if machine.mode == states.HOLD else machine.mode
        has_goal = modes.goal_is_active(machine) or self._mission.active
        return mode == states.GUIDED and has_goal

    def _refusal(
        self, request: CommandOrGoal, kind: "CommandKind", now_ms: int, leader: str
    ) -> int:
        """Return why a request goes neither to the mission nor to the core, or 0."""
        machine = self._machine
        needs_operator = kind.needs_operator or (kind.resumes and self._is_attended)
        # Without any operator the core itself refuses, and shows it in the state of the goal.
        if needs_operator and machine.operator and not self._is_there(leader, now_ms, None):
            return reasons.NO_OPERATOR
        if isinstance(request, GoalRequest):
            return reasons.OK
        if request.ends_id and self._is_over(request):
            return reasons.ALREADY_OVER
        if request.command not in TABLE:
            return reasons.UNKNOWN_COMMAND
        are_finite = all(isfinite(getattr(request, name)) for name in kind.uses)
        return reasons.OK if are_finite else reasons.PARAMETER_OUT_OF_RANGE

    def _is_over(self, request: CommandRequest) -> bool:
        """Return whether the goal or drive that a clean-up names is no longer there."""
        machine = self._machine
        if machine.mode == states.MANUAL:
            return request.ends_id != self.drive_id
        is_live = modes.goal_is_active(machine) or self._mission.active
        return request.ends_id != self.goal_id or not is_live

    def _resume_mission(self, _request: CommandRequest, now_ms: int) -> int | None:
        return self._mission.resume(now_ms) if self._mission.active else None

    def _abort_mission(self, _request: CommandRequest, now_ms: int) -> int | None:
        return self._mission.abort(now_ms) if self._mission.active else None

    def _keep_pose(self, _request: CommandRequest, _now_ms: int) -> int | None:
        return reasons.DRIVING if self._mission.active else None

    def _start_mission(self, request: CommandRequest, now_ms: int) -> int:
        return self._mission.start(int(request.param1), now_ms)

    def _jump(self, request: CommandRequest, now_ms: int) -> int:
        return self._mission.jump(int(request.param1), now_ms)

    def _change_speed(self, request: CommandRequest, _now_ms: int) -> int:
        """Limit the speed of a drive, or of the mission; a program may limit one goal alone."""
        speed_m_s = request.param2
        if speed_m_s == UNCHANGED:
            return reasons.OK
        limit_m_s = None if speed_m_s == DEFAULT else speed_m_s
        if limit_m_s is not None and limit_m_s < LEAST_SPEED_M_S:
            return reasons.PARAMETER_OUT_OF_RANGE
        mission, speed = self._mission, self._mission.speed
        is_on_mission = mission.active and mission.reason_to_end() == reasons.OK
        if is_on_mission and self._machine.mode != states.HOLD:
            speed.set(limit_m_s)
            return reasons.OK
        return speed.order(limit_m_s, self._asking, for_goal=request.param1 == FOR_GOAL)

    def _restart(self, request: CommandRequest, _now_ms: int) -> int:
        """Ask for a restart; a process with a robot that is armed or stopped refuses."""
        if request.param1 != RESTART:
            return reasons.PARAMETER_OUT_OF_RANGE
        vehicles = [one._machine.vehicle for one in self._hosted]
        if states.EMERGENCY_STOP in vehicles:
            return reasons.EMERGENCY_STOPPED
        if states.ACTIVE in vehicles:
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


def goal_in(request: GoalRequest) -> Goal:
    """Return the goal in a request."""
    return goal_of(
        request.x_mm,
        request.y_mm,
        request.heading_urad,
        request.heading_free,
        request.position_tolerance_mm,
        request.heading_tolerance_urad,
    )


def acknowledge(request: CommandOrGoal, reason: int) -> CommandAck:
    """Return the answer with a reason; a goal is acknowledged as DO_REPOSITION."""
    command = Command.DO_REPOSITION if isinstance(request, GoalRequest) else request.command
    return ack(reason, command)


def ack(reason: int, command: int = 0) -> CommandAck:
    """Return a COMMAND_ACK for a reason and a command, if the request is one."""
    return CommandAck(
        command=command,
        result=result_of(reason),
        progress=0,
        result_param2=reason,
        target_system=0,
        target_component=0,
    )


NOTES: Final = (
    *(reasons.NOTHING_LATCHED, reasons.NO_LEASE),
    *(reasons.NOTHING_KEPT, reasons.NOTHING_CHANGED),
)
"""Why an accepted request has changed nothing."""


def result_of(reason: int) -> int:
    """Return the MAV_RESULT that matches a reason."""
    if reason == reasons.OK or reason in NOTES:
        return AckResult.ACCEPTED
    return AckResult.UNSUPPORTED if reason == reasons.UNKNOWN_COMMAND else AckResult.DENIED


class CommandKind(NamedTuple):
    """What a command is, with any value of its parameters or with one of them.

    Parameters that it does not use may have any value: MAVLink sets unused ones to NaN.
    """

    uses: tuple[str, ...] = ()
    value: float | None = None
    """Value of the first parameter used that makes it this kind; without one all others do."""

    only_stops: bool = False
    """It can only stop the robot, so that it needs no lease: standing is never the wrong answer."""

    is_emergency_stop: bool = False
    is_clear: bool = False
    is_arm: bool = False
    is_disarm: bool = False
    keeps_goal: bool = False
    """It promises to keep the goal."""

    by_hand: bool = False
    needs_operator: bool = False
    """The robot moves on it only while its sender is there."""

    resumes: bool = False
    """It continues what was held, as that was: held in GUIDED, it needs an operator."""

    leads_on: bool = False
    """It leads a mission on, which stays that of its driver."""

    by_host: Callable[[Commands, CommandRequest, int], int | None] | None = None
    """What is done without the core; it returns the reason, or None to leave it to the core."""


TABLE: Final[Mapping[int, tuple[CommandKind, ...]]] = MappingProxyType(
    {
        Command.COMPONENT_ARM_DISARM: (
            CommandKind(("param1",), 0.0, only_stops=True, is_disarm=True),
            CommandKind(("param1",), is_arm=True),
        ),
        Command.DO_SET_MODE: (
            CommandKind(("param2",), Mode.HOLD, only_stops=True),
            CommandKind(("param2",), Mode.GUIDED, needs_operator=True),
            CommandKind(("param2",), Mode.MANUAL, needs_operator=True, by_hand=True),
            CommandKind(("param2",)),
        ),
        Command.DO_PAUSE_CONTINUE: (
            CommandKind(("param1",), 0.0, only_stops=True, keeps_goal=True),
            CommandKind(("param1",), resumes=True, by_host=Commands._resume_mission),
        ),
        Command.DO_FLIGHTTERMINATION: (CommandKind(only_stops=True, is_emergency_stop=True),),
        Command.NAV_RETURN_TO_LAUNCH: (CommandKind(),),
        Command.MISSION_START: (CommandKind(("param1",), by_host=Commands._start_mission),),
        Command.DO_SET_MISSION_CURRENT: (
            CommandKind(("param1",), leads_on=True, by_host=Commands._jump),
        ),
        Command.PREFLIGHT_REBOOT_SHUTDOWN: (CommandKind(("param1",), by_host=Commands._restart),),
        Command.DO_CHANGE_SPEED: (
            CommandKind(("param1", "param2"), by_host=Commands._change_speed),
        ),
        Command.SIDESTEP_SET_NAVIGATOR: (CommandKind(("param1", "param2")),),
        Command.SIDESTEP_SET_POSE: (
            CommandKind(("param1", "param2"), by_host=Commands._keep_pose),
        ),
        Command.SIDESTEP_ABORT_GOAL: (
            CommandKind(only_stops=True, by_host=Commands._abort_mission),
        ),
        Command.SIDESTEP_CLEAR_EMERGENCY_STOP: (CommandKind(is_clear=True),),
    }
)
"""The kinds of each command; it is the first one whose value fits."""

NOTHING: Final = CommandKind()


def kind_of(request: Message | None) -> CommandKind:
    """Return what a request is; one that is no command of the table is nothing special."""
    if isinstance(request, GoalRequest):
        return CommandKind(needs_operator=request.mode == Mode.GUIDED)
    if not isinstance(request, CommandRequest):
        return NOTHING
    kinds = TABLE.get(request.command, (NOTHING,))
    return next(
        kind for kind in kinds if kind.value is None or getattr(request, kind.uses[0]) == kind.value
    )


def needs_no_lease(request: Message) -> bool:
    """Return whether a request is allowed without the lease: one that only stops, or only reads."""
    return isinstance(request, READ_ONLY) or kind_of(request).only_stops


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
