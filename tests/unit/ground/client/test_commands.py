"""Commands: accepted, refused, repeated under one id; the pose an operator sets."""

from math import inf, isnan, nan, radians

import pytest

from ground.client.floor import Floor, floor_in
from ground.client.goal import destination
from ground.client.outcomes import Accepted, Operation, Outcome, Refused, RefusedError, agreed
from ground.client.requests import ATTEMPTS
from ground.client.robot_link import UnansweredError
from ground.client.status_line import knows_place, pose_of
from ground.commands.abort import Abort
from ground.commands.arm import Arm
from ground.commands.disarm import Disarm
from ground.commands.goto import Goto
from ground.commands.hold import Hold
from ground.commands.mark import Mark
from ground.commands.mode import SetMode
from ground.commands.navigator import SetNavigator
from ground.commands.pose import SetPose, SetTruePose
from ground.commands.restart import Restart
from ground.commands.resume import Resume
from ground.commands.rtl import ReturnHome
from ground.commands.stop import ClearEmergencyStop, StopNow
from ground.robot import RETRY_NS
from protocol.topics import ODOMETRY, OPERATOR, STATUS, STOP, TRUTH
from protocol.wire.enums import Command, Mode, Navigator, Vehicle
from protocol.wire.messages import CommandRequest, GoalRequest
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError, UserError
from tests.support.each import each
from tests.support.ground.client import ANSWER_NS, HELD, Stage, perform, status
from tests.support.ground.station import WORLD_TEXT, Robot


def test_agreement_is_accepted_with_the_time_it_took() -> None:
    stage = Stage()
    outcome = perform(Hold(), stage)
    assert outcome == Accepted(ANSWER_NS)
    assert outcome.text == "ok 14 ms"
    assert outcome.as_json("hold", "r1") == {
        "verb": "hold",
        "robot": "r1",
        "ok": True,
        "reason": "ok",
        "reason_code": 0,
        "took_ms": 14.0,
    }


def test_refusal_names_the_reason_and_the_remedy() -> None:
    outcome = perform(Arm(), Stage(Reason.EMERGENCY_STOPPED))
    assert isinstance(outcome, Refused)
    assert (outcome.ok, outcome.reason) == (False, Reason.EMERGENCY_STOPPED)
    assert outcome.text.startswith("refused: ")
    assert outcome.text.endswith("(sidestep clear-estop)")
    with pytest.raises(RefusedError, match="clear-estop"):
        agreed(outcome)


def test_refusal_for_the_lease_names_its_holder() -> None:
    stage = Stage(Reason.LEASE_HELD)
    stage.bus.say(*HELD)
    outcome = perform(Arm(), stage)
    assert isinstance(outcome, Refused)
    assert (outcome.holder, "anna (--seize takes it over" in outcome.text) == ("anna", True)


def test_lost_answers_are_asked_for_again_under_one_id() -> None:
    stage = Stage(None, None, Reason.NONE)
    assert perform(Hold(), stage).ok
    assert len(stage.bus.requests) == 3
    assert len({request.request_id for request in stage.bus.requests}) == 1


@each("reason", [Reason.TOO_LATE, Reason.TOO_MANY_REQUESTS])
def test_request_that_the_robot_did_not_look_at_is_repeated(reason: Reason) -> None:
    stage = Stage(reason, Reason.NONE)
    assert perform(Hold(), stage).ok
    assert len(stage.bus.requests) == 2


def test_silence_is_given_up_after_the_time_allowed() -> None:
    stage = Stage(*[None] * 10)
    began_ns = stage.clock.now_ns()
    with pytest.raises(UnansweredError, match="no answer within the time"):
        perform(Hold(timeout_s=0.6), stage)
    assert len(stage.bus.requests) == ATTEMPTS
    assert stage.clock.now_ns() - began_ns >= 600_000_000


@each(
    ("operation", "wire"),
    [
        (SetMode(mode=Mode.MANUAL), (Command.DO_SET_MODE, 1.0, float(Mode.MANUAL))),
        (
            SetNavigator(navigator=Navigator.BUG, side=-1),
            (Command.SIDESTEP_SET_NAVIGATOR, float(Navigator.BUG), -1.0),
        ),
        (Arm(), (Command.COMPONENT_ARM_DISARM, 1.0, 0.0)),
        (Restart(), (Command.PREFLIGHT_REBOOT_SHUTDOWN, 1.0, 0.0)),
    ],
)
def test_values_become_the_parameters_of_the_command(
    operation: Operation[Outcome], wire: tuple[int, float, float]
) -> None:
    stage = Stage()
    perform(operation, stage)
    (request,) = stage.bus.requests
    assert (request.command, request.param1, request.param2) == wire


def test_a_release_names_the_stop_of_the_newest_status() -> None:
    stage = Stage(None, Reason.NONE)
    stage.bus.say(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=7))
    stage.bus.on_ask = lambda _: stage.bus.say(STATUS, status(stop_id=8))
    assert perform(ClearEmergencyStop(), stage).ok
    assert [request.stop_id for request in stage.bus.requests] == [7, 7], "by each repetition"


def test_a_release_names_the_stop_that_was_shown_when_it_was_asked_for() -> None:
    stage = Stage()
    stage.bus.say(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=8))
    perform(ClearEmergencyStop(stop_ids=(7,)), stage)
    assert [request.stop_id for request in stage.bus.requests] == [7]


def test_a_release_names_own_stops_after_the_one_that_was_shown() -> None:
    stage = Stage(Reason.NEWER_STOP, Reason.NEWER_STOP, Reason.NONE)
    assert perform(ClearEmergencyStop(stop_ids=(7, 7, 21, 22, 23)), stage).ok
    assert [request.stop_id for request in stage.bus.requests] == [7, 21, 22]
    assert len({request.request_id for request in stage.bus.requests}) == 3


def test_a_release_that_is_refused_for_another_reason_names_no_other_stop() -> None:
    stage = Stage(Reason.LEASE_HELD)
    assert not perform(ClearEmergencyStop(stop_ids=(7, 21)), stage).ok
    assert [request.stop_id for request in stage.bus.requests if request] == [7]


def test_a_release_is_not_sent_without_a_status() -> None:
    stage = Stage()
    with pytest.raises(UnansweredError, match="no status names the emergency stop to clear"):
        perform(ClearEmergencyStop(), stage)
    assert stage.bus.requests == []


def test_a_refusal_for_a_newer_stop_says_what_to_do() -> None:
    outcome = perform(ClearEmergencyStop(stop_ids=(7,)), Stage(Reason.NEWER_STOP))
    assert outcome.text == (
        "refused: a newer emergency stop was pressed: look, then clear again (sidestep clear-estop)"
    )


def test_what_stops_the_robot_needs_no_lease() -> None:
    plain = (Hold, Resume, Abort, ReturnHome, Arm, Disarm, ClearEmergencyStop)
    still = {operation().verb for operation in plain if not operation().moves}
    assert still == {"hold", "abort", "disarm"}
    assert not StopNow().moves
    assert [mode for mode in Mode if not SetMode(mode=mode).moves] == [Mode.HOLD]


def test_stop_is_repeated_until_the_status_shows_it() -> None:
    stage = Stage(*[Reason.NONE] * 3)

    def show(number: int) -> None:
        if number == 2:
            request = stage.bus.sent[0][1]
            assert isinstance(request, CommandRequest)
            stage.bus.say(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=request.request_id))

    stage.bus.on_ask = show
    stage.run(stage.robot.open())
    outcome = perform(StopNow(), stage)
    assert outcome.ok
    assert outcome.text.startswith("E-STOP acknowledged by r1")
    assert [key for key, _ in stage.bus.sent] == [STOP.path] * 3, "at once, and with each question"


def test_unacknowledged_stop_is_given_up_with_a_warning() -> None:
    stage = Stage()
    stage.bus.say(STATUS, status(Vehicle.ACTIVE))
    stage.run(stage.robot.open())
    outcome = perform(StopNow(timeout_s=0.2), stage)
    assert not outcome.ok
    assert outcome.text.startswith("E-STOP GIVEN UP")
    assert outcome.as_json("estop", "r1")["reason_code"] is None
    assert len(stage.bus.sent) >= 4


def test_mark_reports_that_no_recorder_runs() -> None:
    stage = Stage()
    assert perform(Mark(remark="it turned"), stage).text == "marked: it turned"
    stage.bus.has_subscriber = False
    outcome = perform(Mark(remark="it turned"), stage)
    assert (outcome.ok, outcome.text) == (
        False,
        "no recorder is running: start one with sidestep rec start DIR",
    )


ARM = Command.COMPONENT_ARM_DISARM
START = Command.MISSION_START


def asked_until_accepted(stage: Stage, *, beats: bool = False) -> tuple[int, str]:
    """Return the last reason and the notes."""
    robot = stage.robot
    if beats:
        stage.run(robot.lease.open())
    answer, _ = stage.run(robot.accepted(lambda: robot.request(START), beats=beats))
    reason = answer.reason if isinstance(answer, Refused) else Reason.NONE
    return reason, "".join(f"{note}\n" for note in stage.notes.notes)


def commands(stage: Stage) -> list[int]:
    return [one.command for one in stage.bus.requests]


def beats(stage: Stage) -> int:
    return [key for key, _ in stage.bus.sent].count(OPERATOR.path)


def test_what_the_robot_does_at_once_is_asked_once() -> None:
    stage = Stage()
    assert asked_until_accepted(stage) == (Reason.NONE, "")
    assert commands(stage) == [START]


def test_standby_robot_is_armed_and_request_repeated() -> None:
    stage = Stage(Reason.NOT_ARMED)
    stage.bus.say(STATUS, status(Vehicle.STANDBY))
    assert asked_until_accepted(stage) == (Reason.NONE, "armed\n")
    assert commands(stage) == [START, ARM, START]
    ids = [one.request_id for one in stage.bus.requests]
    assert len(set(ids)) == 3


@each("vehicle", [Vehicle.FAILSAFE, Vehicle.EMERGENCY_STOP])
def test_a_robot_that_was_stopped_for_a_reason_is_never_armed(vehicle: Vehicle) -> None:
    stage = Stage(Reason.NOT_ARMED)
    stage.bus.say(STATUS, status(vehicle))
    assert asked_until_accepted(stage) == (Reason.NOT_ARMED, "")
    assert ARM not in commands(stage)


def test_robot_without_a_status_tells_why_it_cannot_be_armed() -> None:
    """Without a plant its control loop does not run; `arm` tells the cause."""
    stage = Stage(Reason.NOT_ARMED, Reason.NO_SENSES)
    assert asked_until_accepted(stage) == (Reason.NO_SENSES, "")
    assert commands(stage) == [START, ARM]


@each("vehicle", [Vehicle.STANDBY, Vehicle.BOOT])
def test_refused_arming_is_the_answer(vehicle: Vehicle) -> None:
    stage = Stage(Reason.NOT_ARMED, Reason.NO_SENSES)
    stage.bus.say(STATUS, status(vehicle))
    assert asked_until_accepted(stage) == (Reason.NO_SENSES, "")
    assert commands(stage) == [START, ARM]


def test_missing_operator_is_remedied_by_a_heartbeat() -> None:
    stage = Stage(Reason.NO_OPERATOR, Reason.NO_OPERATOR)
    assert asked_until_accepted(stage, beats=True)[0] == Reason.NONE
    assert beats(stage) == 2


def test_no_heartbeat_is_sent_without_beats() -> None:
    stage = Stage(Reason.NO_OPERATOR)
    assert asked_until_accepted(stage)[0] == Reason.NO_OPERATOR
    assert beats(stage) == 0


def test_it_is_not_asked_for_ever() -> None:
    stage = Stage(*[Reason.NO_OPERATOR] * 10_000)
    began_ns = stage.clock.now_ns()
    assert asked_until_accepted(stage, beats=True)[0] == Reason.NO_OPERATOR
    assert RETRY_NS <= stage.clock.now_ns() - began_ns < 2 * RETRY_NS


@each("reason", [Reason.OUTSIDE_FENCE, Reason.LEASE_HELD, Reason.NO_MISSION])
def test_what_nothing_remedies_is_the_answer(reason: Reason) -> None:
    stage = Stage(reason)
    assert asked_until_accepted(stage, beats=True)[0] == reason
    assert commands(stage) == [START]


def sent(stage: Stage) -> CommandRequest:
    (request,) = stage.bus.requests
    assert isinstance(request, CommandRequest)
    assert request.command == Command.SIDESTEP_SET_POSE
    return request


def test_pose_is_sent_in_metres_and_radians() -> None:
    stage = Stage()
    assert perform(SetPose(x_m=1.5, y_m=-2.0, heading_deg=90.0), stage).ok
    request = sent(stage)
    assert (request.param1, request.param2) == (1.5, -2.0)
    assert request.param3 == pytest.approx(radians(90.0))


def test_pose_without_a_heading_leaves_the_heading_open() -> None:
    stage = Stage()
    perform(SetPose(x_m=1.0, y_m=2.0), stage)
    assert isnan(sent(stage).param3)


@each(
    ("pose", "name"),
    [((inf, 0.0, 0.0), "x"), ((0.0, 3e6, 0.0), "y"), ((0.0, 0.0, 361.0), "heading")],
)
def test_pose_out_of_range_is_refused_before_it_is_sent(
    pose: tuple[float, float, float], name: str
) -> None:
    with pytest.raises(UserError, match=name):
        SetPose(x_m=pose[0], y_m=pose[1], heading_deg=pose[2])


@each(("x_m", "words"), [(7.0, "outside the world box"), (2.5, "an obstacle of the world box")])
def test_pose_outside_the_world_is_not_set_unless_anyway(x_m: float, words: str) -> None:
    stage = Stage()
    stage.floor = floor_in(WORLD_TEXT)
    with pytest.raises(UserError, match=rf"pose \({x_m:.3f}, 1.400\) lies .*{words}.*; --anyway"):
        perform(SetPose(x_m=x_m, y_m=1.4), stage)
    assert stage.bus.requests == []
    assert perform(SetPose(x_m=x_m, y_m=1.4, anyway=True), stage).ok
    assert sent(stage).param1 == x_m


def test_pose_inside_the_world_is_set() -> None:
    stage = Stage()
    stage.floor = floor_in(WORLD_TEXT)
    assert perform(SetPose(x_m=1.0, y_m=1.0), stage).ok
    assert sent(stage).param1 == 1.0


def test_truth_of_the_plant_becomes_the_pose() -> None:
    stage = Stage()
    stage.bus.say(TRUTH, Robot(x_m=2.5).truth())
    assert isinstance(perform(SetTruePose(), stage), Accepted)
    request = sent(stage)
    assert (request.param1, request.param2, request.param3) == (2.5, 0.0, 0.0)


def test_without_a_simulation_there_is_no_truth() -> None:
    stage = Stage()
    with pytest.raises(RemoteError, match="use `pose set X Y DEG`"):
        perform(SetTruePose(), stage)
    assert stage.bus.requests == []


def test_refused_goal_names_the_command_that_sets_the_place() -> None:
    outcome = perform(Goto(goal=destination([1.0, 2.0]), wait=False), Stage(Reason.PLACE_UNKNOWN))
    assert isinstance(outcome, Refused)
    assert "does not know where it is" in outcome.text
    assert "pose set X Y DEG" in outcome.text


@each("seen_by_robot", [True, False])
def test_goal_says_that_it_was_given_relative_to_the_robot(seen_by_robot: bool) -> None:
    stage = Stage()
    stage.bus.say(ODOMETRY, Robot(placed=False).odometry())
    goto = Goto(goal=destination([1.0, 0.0]), seen_by_robot=seen_by_robot, wait=False)
    assert perform(goto, stage).ok
    (goal,) = stage.bus.requests
    assert isinstance(goal, GoalRequest)
    assert goal.from_robot == int(seen_by_robot)


def test_pose_of_a_robot_without_a_place_is_no_number() -> None:
    assert knows_place(Robot().odometry())
    lost = Robot(placed=False).odometry()
    assert not knows_place(lost)
    assert pose_of(lost) == "PLACE UNKNOWN"
    assert isnan(lost.cov_hh_rad2)
    assert nan != lost.cov_xx_m2


@each(("placed", "anyway"), [(True, False), (True, True), (False, False)])
def test_goal_ahead_that_is_outside_the_world_is_refused(placed: bool, anyway: bool) -> None:
    stage = Stage()
    stage.bus.say(ODOMETRY, Robot(x_m=3.0, placed=placed).odometry())
    stage.floor = Floor("box", 6.0, 4.0)
    goto = Goto(goal=destination([4.0, 0.0]), seen_by_robot=True, wait=False, anyway=anyway)
    if placed and not anyway:
        with pytest.raises(UserError, match=r"goal \(7\.000, 0\.000\) lies outside the world box"):
            perform(goto, stage)
        assert stage.bus.requests == []
    else:
        assert perform(goto, stage).ok
