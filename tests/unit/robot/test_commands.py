"""Commands: acted on once, answered, and allowed without the lease or not."""

from collections.abc import Iterator
from math import inf, nan

import msgspec
import pytest

from checks.harness.messages import make
from checks.simulation.invariants.limits import is_free
from protocol.topics import SERVICES, Role
from protocol.wire.enums import (
    AckResult,
    Command,
    GoalState,
    LeaseAction,
    MissionState,
    Mode,
    Navigator,
)
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    MissionRequestInt,
    MissionRequestList,
    MissionVerdict,
    ParamRequestRead,
)
from protocol.wire.reasons import Reason
from robot.commands import (
    MAX_ANSWERS,
    MAX_OPERATORS,
    AnswerCache,
    Commands,
    acknowledge,
    kind_of,
    result_of,
)
from robot.core import states
from robot.core.parameters import DEFAULTS
from robot.hosting import InProcessCore
from robot.mission import MissionExecutor
from robot.vehicle import RobotVehicle
from tests.support.each import each
from tests.support.robots import Desk, goal, line

ADA = "ada/1"
ADAS_OTHER = "ada/3"
BOB = "bob/2"


class Robot:
    """Commands, state and mission of an armed robot with fresh sensor data, without a bus."""

    def __init__(self) -> None:
        self.core = InProcessCore(DEFAULTS)
        self.state = self.core.state
        self.machine = self.state.machine
        self.machine.vehicle, self.machine.senses = states.ACTIVE, True
        self.mission = MissionExecutor(self.core)
        self.commands = Commands(self.core, self.mission)

    def ask(self, request: CommandRequest | GoalRequest, operator: str = ADA) -> int:
        return self.commands.receive(request, 0, operator).result_param2

    def on_a_mission(self) -> "Robot":
        assert self.mission.put(tuple(line(2))) == (None, Reason.NONE)
        assert self.ask(command(Command.MISSION_START, 0.0, request_id=1000)) == Reason.NONE
        return self


def command(
    number: int, param1: float = 0.0, param2: float = 0.0, request_id: int = 1
) -> CommandRequest:
    return CommandRequest(request_id=request_id, command=number, param1=param1, param2=param2)


def hold(request_id: int) -> CommandRequest:
    return command(Command.DO_PAUSE_CONTINUE, 0.0, request_id=request_id)


STOP = command(Command.DO_FLIGHTTERMINATION, 1.0, request_id=7)
CLEAR = command(Command.SIDESTEP_CLEAR_EMERGENCY_STOP, request_id=8)


def test_pose_is_refused_during_a_mission() -> None:
    robot = Robot().on_a_mission()
    robot.mission.state = MissionState.HOLDING
    robot.machine.goal_state = GoalState.REACHED
    request = command(Command.SIDESTEP_SET_POSE, 1.0, 2.0)
    assert robot.ask(request) == Reason.DRIVING
    robot.mission.state = MissionState.DONE
    assert robot.ask(command(Command.SIDESTEP_SET_POSE, 1.0, 2.0, 2)) == Reason.NONE
    assert robot.state.odometry.pose == (1.0, 2.0, 0.0)


def test_goal_from_the_robot_needs_no_place() -> None:
    robot = Robot()
    robot.machine.placed = False
    assert robot.ask(goal(5, 1.0, 0.0)) == Reason.PLACE_UNKNOWN
    fields = {name: getattr(goal(6, 1.0, 0.0), name) for name in GoalRequest.__struct_fields__}
    assert robot.ask(GoalRequest(**(fields | {"from_robot": 1}))) == Reason.NONE


# Each request is acted on once, for its operator.


def test_new_robot_has_no_goal_id_and_no_stop_id() -> None:
    robot = Robot()
    assert (robot.commands.goal_id, robot.commands.stop_id) == (0, 0)


def test_repeated_request_is_answered_without_effect() -> None:
    robot = Robot()
    assert robot.ask(hold(5)) == Reason.NOTHING_KEPT
    robot.machine.mode = states.AUTO
    assert robot.commands.receive(hold(5), 0, ADA).result == AckResult.ACCEPTED
    assert robot.machine.mode == states.AUTO


def test_another_request_under_a_known_id_is_refused() -> None:
    robot = Robot()
    robot.ask(hold(5))
    for other in (
        command(Command.COMPONENT_ARM_DISARM, 0.0, request_id=5),
        command(Command.DO_PAUSE_CONTINUE, 1.0, request_id=5),
        goal(5, 1.0, 0.0),
    ):
        assert robot.ask(other) == Reason.ID_REUSED
    assert robot.machine.vehicle == states.ACTIVE
    assert robot.machine.goal is None
    assert robot.ask(hold(5)) == Reason.NOTHING_KEPT, "the first keeps the id"


def test_repeated_request_with_nan_is_recognised() -> None:
    robot = Robot()
    for _ in range(2):
        assert robot.ask(command(Command.DO_PAUSE_CONTINUE, 0.0, nan)) == Reason.NOTHING_KEPT


def test_operators_have_ids_of_their_own() -> None:
    robot = Robot()
    robot.ask(hold(5), ADA)
    assert robot.ask(goal(5, 1.0, 0.0), BOB) == Reason.NONE
    assert robot.machine.goal_state == GoalState.ACCEPTED


def test_unnamed_operators_count_as_one() -> None:
    robot = Robot()
    robot.ask(hold(5), "")
    answer = robot.commands.receive(goal(5, 1.0, 0.0), 0)
    assert answer.result_param2 == Reason.ID_REUSED


# Whose heartbeat a request needs.


@each("mode", list(Mode))
def test_a_mode_that_an_operator_watches_needs_one(mode: Mode) -> None:
    request = command(Command.DO_SET_MODE, 1.0, float(mode))
    assert kind_of(request).needs_operator == (mode in {Mode.GUIDED, Mode.MANUAL})


@each(
    ("mode", "resume_mode", "param1", "needed"),
    [
        (states.HOLD, states.GUIDED, 1.0, True),
        (states.HOLD, states.GUIDED, 0.0, False),
        (states.HOLD, states.AUTO, 1.0, False),
        (states.AUTO, states.GUIDED, 1.0, False),
    ],
)
def test_only_to_resume_a_held_guided_drive_needs_an_operator(
    mode: int, resume_mode: int, param1: float, needed: bool
) -> None:
    robot = Robot()
    robot.ask(goal(1, 1.0, 0.0))
    robot.machine.mode, robot.machine.resume_mode, robot.machine.operator = mode, resume_mode, True
    robot.commands = Commands(robot.core, robot.mission, lambda *_: False)
    reason = robot.ask(command(Command.DO_PAUSE_CONTINUE, param1, request_id=2))
    assert (reason == Reason.NO_OPERATOR) == needed


def test_without_a_goal_nobody_is_missed_to_resume_it() -> None:
    robot = Robot()
    robot.machine.operator = True
    robot.commands = Commands(robot.core, robot.mission, lambda *_: False)
    assert robot.ask(command(Command.DO_PAUSE_CONTINUE, 1.0)) == Reason.NO_GOAL


def test_without_heartbeats_to_judge_by_every_operator_is_there() -> None:
    robot = Robot()
    robot.machine.operator = True
    assert robot.ask(command(Command.DO_SET_MODE, 1.0, float(Mode.GUIDED))) == Reason.NONE


# The emergency stop.


def test_a_stop_under_a_known_id_stops() -> None:
    robot = Robot()
    robot.ask(hold(STOP.request_id))
    answer = robot.commands.receive(STOP, 0, ADA)
    assert (answer.command, answer.result_param2) == (Command.DO_FLIGHTTERMINATION, Reason.NONE)
    assert robot.machine.vehicle == states.EMERGENCY_STOP


def test_a_repeated_stop_stops_again_and_is_named() -> None:
    robot = Robot()
    for request_id in (7, 7, 9):
        stop = command(Command.DO_FLIGHTTERMINATION, 1.0, request_id=request_id)
        robot.machine.vehicle = states.ACTIVE
        assert robot.ask(stop) == Reason.NONE
        assert robot.machine.vehicle == states.EMERGENCY_STOP
        assert robot.commands.stop_id == request_id


def stopped_by(*request_ids: int) -> Robot:
    """Return a robot that is stopped by one stop after the other."""
    robot = Robot()
    for request_id in request_ids:
        robot.ask(command(Command.DO_FLIGHTTERMINATION, 1.0, request_id=request_id))
    return robot


@each(
    ("pressed", "newest"),
    [((7, 8), 8), ((7, 8, 7), 8), ((7, 8, 7, 9, 8), 9), ((*range(257), 1), 256)],
)
def test_a_late_copy_of_a_latched_stop_is_not_the_newest(
    pressed: tuple[int, ...], newest: int
) -> None:
    robot = stopped_by(*pressed)
    assert robot.commands.stop_id == newest
    assert all(robot.commands.is_stopped_by(request_id) for request_id in pressed[1:])
    assert not robot.commands.is_stopped_by(1000)


@each(
    ("pressed", "shown"),
    [
        ((), [0, 0]),
        ((7,), [7, 7]),
        ((7, 7), [7, 7]),
        ((7, 8, 7), [7, 8, 8]),
        ((7, 8, 9, 7, 8), [8, 9, 9]),
        ((7, 8, 7, 8), [8, 8]),
        ((7, 8, 7, 9), [9, 9]),
        ((0, 8, 0), [0, 8, 8]),
    ],
)
def test_a_copy_of_an_earlier_stop_is_shown_once(
    pressed: tuple[int, ...], shown: list[int]
) -> None:
    """Its sender sees it acknowledged; a clear must name the newest."""
    robot = stopped_by(*pressed)
    newest = robot.commands.stop_id
    assert [robot.commands.take_shown_stop() for _ in shown] == shown
    assert robot.commands.stop_id == newest


def test_a_copy_of_a_released_stop_is_new_and_stays_shown() -> None:
    robot = stopped_by(7, 8)
    robot.machine.vehicle = states.STANDBY
    robot.ask(STOP)
    assert [robot.commands.take_shown_stop() for _ in range(2)] == [STOP.request_id] * 2


def test_the_oldest_of_many_stops_is_forgotten() -> None:
    assert not stopped_by(*range(257)).commands.is_stopped_by(0)


def test_a_late_copy_of_a_released_stop_is_the_newest() -> None:
    robot = stopped_by(7, 8)
    robot.machine.vehicle = states.STANDBY
    assert not robot.commands.is_stopped_by(8)
    robot.ask(STOP)
    assert robot.commands.stop_id == STOP.request_id
    assert not robot.commands.is_stopped_by(8), "it has been released"


def test_stop_is_not_stored_with_the_answers() -> None:
    robot = Robot()
    robot.ask(STOP)
    assert robot.ask(hold(STOP.request_id)) == Reason.NOTHING_KEPT


def test_only_an_emergency_stop_is_recognised_as_one() -> None:
    assert kind_of(STOP).is_emergency_stop
    assert not kind_of(CLEAR).is_emergency_stop
    assert not kind_of(goal(Command.DO_FLIGHTTERMINATION, 0.0, 0.0)).is_emergency_stop
    assert not kind_of(None).is_emergency_stop


def test_only_a_release_is_recognised_as_one() -> None:
    assert kind_of(CLEAR).is_clear
    assert not kind_of(STOP).is_clear
    assert not kind_of(goal(Command.SIDESTEP_CLEAR_EMERGENCY_STOP, 0.0, 0.0)).is_clear
    assert not kind_of(None).is_clear


# The stored answers are limited.


def found(answered: AnswerCache, operator: str, request_id: int) -> bool:
    return answered.find(operator, hold(request_id)) is not None


def keep(answered: AnswerCache, operator: str, request_id: int) -> None:
    answered.keep(operator, hold(request_id), acknowledge(hold(request_id), Reason.NONE))


def test_the_newest_32_answers_of_an_operator_are_kept() -> None:
    assert MAX_ANSWERS == 32
    answered = AnswerCache()
    for request_id in range(100):
        keep(answered, ADA, request_id)
    assert [request_id for request_id in range(100) if found(answered, ADA, request_id)] == (
        list(range(68, 100))
    )


def test_answers_of_the_64_newest_operators_are_kept() -> None:
    assert MAX_OPERATORS == 64
    answered = AnswerCache()
    for number in range(64):
        keep(answered, f"op/{number}", 1)
    keep(answered, "op/0", 2)
    for number in range(100, 110):
        keep(answered, f"op/{number}", 1)
    kept = {number for number in range(110) if found(answered, f"op/{number}", 1)}
    assert kept == {0, *range(11, 64), *range(100, 110)}


def test_flood_of_one_operator_keeps_answers_of_others() -> None:
    answered = AnswerCache()
    keep(answered, ADA, 1)
    for request_id in range(1000):
        keep(answered, BOB, request_id)
    assert found(answered, ADA, 1)


# Answers.


def test_an_answer_names_command_result_and_reason() -> None:
    assert acknowledge(hold(1), Reason.NOT_ARMED) == CommandAck(
        command=Command.DO_PAUSE_CONTINUE,
        result=AckResult.DENIED,
        progress=0,
        result_param2=Reason.NOT_ARMED,
        target_system=0,
        target_component=0,
    )


def test_an_answer_about_no_command_names_none() -> None:
    answer = lent().receive(LeaseRequest(request_id=1, action=LeaseAction.TAKE, name=""), 0, BOB)
    assert isinstance(answer, CommandAck)
    assert (answer.command, answer.result_param2) == (0, Reason.LEASE_HELD)


def test_a_goal_is_acknowledged_as_do_reposition() -> None:
    assert acknowledge(goal(1, 0.0, 0.0), Reason.NONE).command == Command.DO_REPOSITION


@each("reason", Reason)
def test_a_result_follows_from_its_reason(reason: Reason) -> None:
    results = {
        Reason.NONE: AckResult.ACCEPTED,
        Reason.UNKNOWN_COMMAND: AckResult.UNSUPPORTED,
        Reason.NOTHING_LATCHED: AckResult.ACCEPTED,
        Reason.NO_LEASE: AckResult.ACCEPTED,
        Reason.NOTHING_KEPT: AckResult.ACCEPTED,
        Reason.NOTHING_CHANGED: AckResult.ACCEPTED,
    }
    assert result_of(reason) == results.get(reason, AckResult.DENIED)


# The request that set the goal.


def test_a_goal_is_named_by_the_request_that_led_to_it() -> None:
    robot = Robot()
    robot.ask(goal(21, 1.0, 0.0))
    assert robot.commands.goal_id == 21
    robot.ask(hold(22))
    robot.ask(goal(23, 1e6, 0.0))
    assert robot.commands.goal_id == 21, "no new goal"
    robot.on_a_mission()
    assert robot.commands.goal_id == 1000


# The effect of each command.


def test_the_core_gets_no_command_that_the_table_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    reached: list[CommandRequest] = []

    def reach(_core: InProcessCore, request: CommandRequest, _now_ms: int) -> int:
        reached.append(request)
        return Reason.NONE

    monkeypatch.setattr(InProcessCore, "command", reach)
    robot = Robot()
    assert robot.ask(command(31_000, nan)) == Reason.UNKNOWN_COMMAND
    assert reached == []
    assert robot.ask(hold(2)) == Reason.NOTHING_KEPT
    assert reached == [hold(2)]


@each(("arm", "vehicle"), [(0.0, states.STANDBY), (1.0, states.ACTIVE), (2.0, states.ACTIVE)])
def test_arming_and_disarming_are_one_command(arm: float, vehicle: int) -> None:
    for before in (states.STANDBY, states.ACTIVE):
        robot = Robot()
        robot.machine.vehicle = before
        note = Reason.NOTHING_CHANGED if before == vehicle else Reason.NONE
        assert robot.ask(command(Command.COMPONENT_ARM_DISARM, arm)) == note
        assert robot.machine.vehicle == vehicle


@each("vehicle", [states.FAILSAFE, states.EMERGENCY_STOP])
def test_disarming_ends_a_failsafe_but_no_emergency_stop(vehicle: int) -> None:
    robot = Robot()
    robot.machine.vehicle = vehicle
    is_over = vehicle == states.FAILSAFE
    note = Reason.NONE if is_over else Reason.NOTHING_CHANGED
    assert robot.ask(command(Command.COMPONENT_ARM_DISARM, 0.0)) == note
    assert robot.machine.vehicle == (states.STANDBY if is_over else vehicle)


def test_continue_resumes_the_goal_that_pause_has_held() -> None:
    robot = Robot()
    robot.ask(goal(1, 1.0, 0.0))
    robot.ask(command(Command.DO_PAUSE_CONTINUE, 0.0, request_id=2))
    assert robot.machine.mode == states.HOLD
    assert robot.ask(command(Command.DO_PAUSE_CONTINUE, 1.0, request_id=3)) == Reason.NONE
    assert robot.machine.mode == states.AUTO


def test_continue_keeps_the_program_that_drives_while_it_is_there() -> None:
    robot = Robot()
    present = {ADA}
    robot.machine.operator = True
    robot.commands = Commands(robot.core, robot.mission, lambda who, *_: who in present)
    assert robot.ask(goal(1, 1.0, 0.0, Mode.GUIDED)) == Reason.NONE
    assert robot.ask(hold(2), ADAS_OTHER) == Reason.NONE
    resume = command(Command.DO_PAUSE_CONTINUE, 1.0, request_id=3)
    assert robot.ask(resume, ADAS_OTHER) == Reason.NONE
    assert (robot.machine.mode, robot.commands.driver) == (states.GUIDED, ADA)
    assert robot.ask(hold(4), ADAS_OTHER) == Reason.NONE
    present.clear()
    resume = command(Command.DO_PAUSE_CONTINUE, 1.0, request_id=5)
    assert robot.ask(resume, ADAS_OTHER) == Reason.NO_OPERATOR
    present.add(ADAS_OTHER)
    resume = command(Command.DO_PAUSE_CONTINUE, 1.0, request_id=6)
    assert robot.ask(resume, ADAS_OTHER) == Reason.NONE
    assert robot.commands.driver == ADAS_OTHER


def test_continue_by_another_person_makes_his_program_the_driver() -> None:
    robot = Robot()
    present = {ADA}
    robot.machine.operator = True
    robot.commands = Commands(robot.core, robot.mission, lambda who, *_: who in present)
    assert robot.ask(goal(1, 1.0, 0.0, Mode.GUIDED)) == Reason.NONE
    assert robot.ask(hold(2), BOB) == Reason.NONE
    resume = command(Command.DO_PAUSE_CONTINUE, 1.0, request_id=3)
    assert robot.ask(resume, BOB) == Reason.NO_OPERATOR
    present.add(BOB)
    resume = command(Command.DO_PAUSE_CONTINUE, 1.0, request_id=4)
    assert robot.ask(resume, BOB) == Reason.NONE
    assert (robot.machine.mode, robot.commands.driver) == (states.GUIDED, BOB)


def test_continue_without_goal_and_mission_is_refused() -> None:
    assert Robot().ask(command(Command.DO_PAUSE_CONTINUE, 1.0)) == Reason.NO_GOAL


def test_continue_resumes_a_mission_between_its_goals() -> None:
    robot = Robot().on_a_mission()
    robot.mission.state = MissionState.PAUSED
    robot.machine.mode, robot.machine.resume_mode = states.HOLD, states.AUTO
    robot.machine.goal_state = states.REACHED
    assert robot.ask(command(Command.DO_PAUSE_CONTINUE, 1.0)) == Reason.NONE
    assert robot.machine.mode == states.AUTO


def test_abort_ends_the_mission_or_else_the_goal() -> None:
    on_a_mission = Robot().on_a_mission()
    assert on_a_mission.ask(command(Command.SIDESTEP_ABORT_GOAL)) == Reason.NONE
    assert not on_a_mission.mission.active
    robot = Robot()
    assert robot.ask(command(Command.SIDESTEP_ABORT_GOAL)) == Reason.NOTHING_TO_ABORT
    robot.ask(goal(2, 1.0, 0.0))
    assert robot.ask(command(Command.SIDESTEP_ABORT_GOAL, request_id=3)) == Reason.NONE
    assert robot.machine.goal_state == GoalState.ABORTED


@each(
    ("asked", "side"), [(0, states.RIGHT), (states.LEFT, states.LEFT), (states.RIGHT, states.RIGHT)]
)
def test_a_navigator_without_a_side_keeps_the_side_there_is(asked: int, side: int) -> None:
    robot = Robot()
    robot.machine.side = states.RIGHT
    assert robot.ask(command(Command.SIDESTEP_SET_NAVIGATOR, Navigator.BUG2, asked)) == Reason.NONE
    assert (robot.machine.navigator, robot.machine.side) == (Navigator.BUG2, side)


def test_a_mode_is_set_by_the_second_field_as_in_mavlink() -> None:
    robot = Robot()
    assert robot.ask(command(Command.DO_SET_MODE, 1.0, Mode.AUTO)) == Reason.NONE
    assert robot.machine.mode == states.AUTO


@each(
    ("vehicle", "action", "reason"),
    [
        (states.BOOT, 1.0, Reason.NONE),
        (states.STANDBY, 1.0, Reason.NONE),
        (states.FAILSAFE, 1.0, Reason.NONE),
        (states.ACTIVE, 1.0, Reason.ARMED),
        (states.EMERGENCY_STOP, 1.0, Reason.EMERGENCY_STOPPED),
        (states.STANDBY, 0.0, Reason.PARAMETER_OUT_OF_RANGE),
        (states.STANDBY, 2.0, Reason.PARAMETER_OUT_OF_RANGE),
        (states.STANDBY, nan, Reason.PARAMETER_OUT_OF_RANGE),
    ],
)
def test_restart_needs_a_robot_that_is_disarmed(
    vehicle: int, action: float, reason: Reason
) -> None:
    robot = Robot()
    robot.machine.vehicle = vehicle
    assert robot.ask(command(Command.PREFLIGHT_REBOOT_SHUTDOWN, action)) == reason
    assert robot.commands.restarts == (reason == Reason.NONE)


def test_only_a_request_to_arm_arms() -> None:
    arm = Command.COMPONENT_ARM_DISARM
    assert kind_of(command(arm, 1.0)).is_arm
    assert kind_of(command(arm, 0.5)).is_arm, "as the core reads it"
    assert not kind_of(command(arm, 0.0)).is_arm
    assert not kind_of(command(Command.DO_SET_MODE, 1.0)).is_arm
    assert not kind_of(goal(1, 1.0, 1.0)).is_arm
    assert not kind_of(None).is_arm


FREE_COMMANDS = {
    (Command.DO_FLIGHTTERMINATION, 0.0),
    (Command.DO_FLIGHTTERMINATION, 1.0),
    (Command.DO_PAUSE_CONTINUE, 0.0),
    (Command.SIDESTEP_ABORT_GOAL, 0.0),
    (Command.SIDESTEP_ABORT_GOAL, 1.0),
    (Command.COMPONENT_ARM_DISARM, 0.0),
}
FREE_MODES = {Mode.HOLD}
FREE_MESSAGES = (ParamRequestRead, MissionRequestList, MissionRequestInt)
"""What an operator without the lease may have: all else is refused."""


def every_request() -> Iterator[Message]:
    for service in SERVICES:
        for kind in service.requests if service.server is Role.ROBOT else ():
            if kind is CommandRequest:
                for command in Command:
                    for param1 in (0.0, 1.0):
                        yield make(kind, command=command, param1=param1, request_id=1)
                for mode in (*Mode, nan):
                    values = {"command": Command.DO_SET_MODE, "param2": float(mode)}
                    yield make(kind, **values, request_id=1)
            elif kind is LeaseRequest:
                for action in LeaseAction:
                    yield make(kind, action=action, name="Bob")
            else:
                yield make(kind)


def lent() -> RobotVehicle:
    """Return a vehicle whose lease Ada holds."""
    vehicle = Desk().vehicle
    taken = vehicle.receive(LeaseRequest(request_id=1, action=LeaseAction.TAKE, name="Ada"), 0, ADA)
    assert isinstance(taken, CommandAck)
    assert taken.result_param2 == Reason.NONE
    return vehicle


def test_every_program_of_the_holder_may_have_all() -> None:
    for request in every_request():
        answer = lent().receive(request, 0, "ada/2")
        if isinstance(answer, CommandAck | MissionVerdict):
            assert reason_of(answer) != Reason.LEASE_HELD, request


@pytest.mark.parametrize("operator", [BOB, ""])
def test_without_the_lease_all_is_refused_but_the_table(operator: str) -> None:
    requests = list(every_request())
    assert {one.command for one in requests if isinstance(one, CommandRequest)} == set(Command)
    assert len({type(one) for one in requests}) > 8
    for request in requests:
        free = isinstance(request, FREE_MESSAGES)
        if isinstance(request, CommandRequest):
            free = (request.command, request.param1) in FREE_COMMANDS
            if request.command == Command.DO_SET_MODE:
                free = request.param2 in FREE_MODES
        if isinstance(request, LeaseRequest):
            free = request.action == LeaseAction.SEIZE and operator != ""
        answer = lent().receive(request, 0, operator)
        refused = isinstance(answer, CommandAck | MissionVerdict) and reason_of(answer) in (
            Reason.LEASE_HELD,
            Reason.NO_OPERATOR,
        )
        assert refused != free, request
        assert is_free(request) == free or operator == "", request


def reason_of(answer: CommandAck | MissionVerdict) -> int:
    return answer.reason if isinstance(answer, MissionVerdict) else answer.result_param2


# Speeds that operators order.


def speed_of(robot: Robot) -> float:
    """Return the speed that the next step drives with at most."""
    robot.mission.step(0)
    return robot.core._driven.v_max_m_s


def slow(request_id: int, speed_m_s: float = 0.1, *, for_goal: bool = False) -> CommandRequest:
    return command(Command.DO_CHANGE_SPEED, float(for_goal), speed_m_s, request_id)


USUAL_M_S = DEFAULTS.v_max_m_s


def guided() -> Robot:
    robot = Robot()
    robot.machine.operator = True
    robot.machine.mode = states.GUIDED
    return robot


def in_guided(request_id: int) -> GoalRequest:
    return msgspec.structs.replace(goal(request_id, 1.0, 0.0), mode=Mode.GUIDED)


def test_speed_needs_a_drive_and_a_usable_value() -> None:
    robot = Robot()
    assert robot.ask(slow(1)) == Reason.NO_GOAL
    assert robot.ask(slow(2, -1.0)) == Reason.NONE, "it changes nothing"
    robot = guided()
    assert robot.ask(slow(1, for_goal=True)) == Reason.NO_GOAL
    for at, wrong in enumerate((0.0, 0.001, -3.0, nan, inf), start=2):
        assert robot.ask(slow(at, wrong)) == Reason.PARAMETER_OUT_OF_RANGE
    robot.machine.vehicle = states.STANDBY
    assert robot.ask(slow(9)) == Reason.NOT_ARMED
    assert speed_of(robot) == USUAL_M_S


def test_speed_of_a_goal_ends_with_it() -> None:
    robot = guided()
    for request_id, end in enumerate((GoalState.REACHED, GoalState.STUCK, None), start=1):
        assert robot.ask(goal(10 * request_id, 1.0, 0.0)) == Reason.NONE
        assert robot.ask(slow(10 * request_id + 1, for_goal=True)) == Reason.NONE
        assert speed_of(robot) == 0.1
        if end is None:
            assert robot.ask(goal(99, 2.0, 0.0)) == Reason.NONE
        else:
            robot.machine.goal_state = end
        assert speed_of(robot) == USUAL_M_S
    assert robot.core.params == DEFAULTS


@each("end", [hold(50), command(Command.COMPONENT_ARM_DISARM, 0.0, request_id=50), STOP])
def test_speed_of_a_mode_ends_with_the_mode_or_the_drive(end: CommandRequest) -> None:
    robot = guided()
    assert robot.ask(slow(1)) == Reason.NONE
    for request_id in (2, 3):
        assert robot.ask(in_guided(request_id)) == Reason.NONE
        assert speed_of(robot) == 0.1
    assert robot.ask(end) == Reason.NONE
    assert speed_of(robot) == USUAL_M_S


def test_speed_of_one_program_slows_no_goal_of_another() -> None:
    robot = guided()
    assert robot.ask(slow(1), ADA) == Reason.NONE
    assert robot.ask(in_guided(2), ADA) == Reason.NONE
    assert speed_of(robot) == 0.1
    assert robot.ask(in_guided(3), BOB) == Reason.NONE
    assert speed_of(robot) == USUAL_M_S


def test_speed_can_be_ended() -> None:
    robot = guided()
    robot.ask(slow(1))
    assert robot.ask(slow(2, -2.0)) == Reason.NONE
    assert speed_of(robot) == USUAL_M_S


def test_speed_during_a_mission_ends_with_it() -> None:
    robot = Robot().on_a_mission()
    assert robot.ask(slow(1)) == Reason.NONE
    assert speed_of(robot) == 0.1
    robot.ask(command(Command.SIDESTEP_ABORT_GOAL, request_id=2))
    assert speed_of(robot) == USUAL_M_S


def test_speed_of_a_goal_outlives_the_mission_that_it_replaces() -> None:
    robot = Robot().on_a_mission()
    robot.machine.operator = True
    assert robot.ask(goal(5, 1.0, 0.0)) == Reason.NONE
    assert robot.ask(slow(6, for_goal=True)) == Reason.NONE
    assert speed_of(robot) == 0.1
    assert robot.mission.state == MissionState.FAILED
    assert speed_of(robot) == 0.1
