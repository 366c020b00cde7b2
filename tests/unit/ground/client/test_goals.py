"""Goals: as typed, inside the known world, followed to their end, aborted, and resumed."""

import argparse
import json
from asyncio import CancelledError
from math import dist, inf, nan, pi, radians
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from ground.cli.main import parse
from ground.client.floor import Floor, floor_in, floor_of
from ground.client.goal import Destination, destination, from_robot, goal_request
from ground.client.lost_drive import (
    LostGoal,
    LostMission,
    LostReturn,
    NothingToResume,
    Resumed,
    lost_drive,
)
from ground.client.outcomes import Accepted, GoalEnded, Refused, RefusedError
from ground.commands.command import command_in, positive, seconds
from ground.commands.goto import Goto
from ground.commands.mission import ResumeMission, UploadMission
from ground.commands.resume import Resume
from ground.missions.mission import Mission, Waypoint
from ground.missions.transfer import items_of
from protocol.topics import LEASE, MISSION, MISSION_SERVICE, STATUS
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import (
    Command,
    GoalState,
    LeaseAction,
    MissionState,
    MissionType,
    Mode,
    Vehicle,
)
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    MissionCount,
    MissionStatus,
    NavigatorStatus,
)
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError, UserError
from tests.support.each import each
from tests.support.ground.client import HELD, STANDBY, Reply, Stage, lease_of, perform, status
from tests.support.ground.station import WORLD_TEXT


def typed(*words: str) -> Goto:
    parser = argparse.ArgumentParser(exit_on_error=False)
    Goto.declare(parser)
    command = Goto.parsed(parser.parse_args(list(words)))
    assert isinstance(command, Goto)
    return command


def test_metres_and_degrees_become_millimetres_and_microradians() -> None:
    near = typed("2", "1", "--position-tolerance", "0.1").goal
    assert near == destination([2.0, 1.0], position_tolerance_m=0.1)
    where = typed("2", "-1.5", "90", "--tolerance", "0.1").goal
    assert where is not None
    request = goal_request(where.on_the_wire(), 7, Mode.GUIDED)
    assert (request.x_mm, request.y_mm) == (2000, -1500)
    assert request.heading_urad == round(pi / 2 * 1e6)
    assert (request.heading_free, request.position_tolerance_mm) == (0, 100)
    assert (request.request_id, request.mode) == (7, Mode.GUIDED)


def test_without_a_heading_any_will_do() -> None:
    assert goal_request(destination([1.0, 2.0]).on_the_wire(), 1, Mode.AUTO).heading_free == 1


@each(
    ("words", "named"),
    [
        (("3e6", "0"), "x"),
        (("0", "-3000000"), "y"),
        (("0", "0", "361"), "heading"),
        (("0", "0", "--tolerance", "2"), "tolerance"),
        (("0", "0", "--heading-tolerance", "181"), "heading tolerance"),
    ],
)
def test_what_no_robot_can_take_is_named(words: tuple[str, ...], named: str) -> None:
    with pytest.raises(UserError, match=rf"^{named} .* out of range"):
        typed(*words)


@each("text", ["0", "-1", "nan", "1e9"])
def test_a_time_is_positive_and_bounded(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        seconds(text)
    if text == "1e9":
        assert positive(text) == 1e9


numbers = st.floats() | st.sampled_from([nan, inf, -inf])


@given(st.lists(numbers, max_size=4), numbers, numbers)
def test_a_goal_fits_the_wire_or_is_refused(
    values: list[float], tolerance_m: float, tolerance_deg: float
) -> None:
    try:
        where = destination(
            values, position_tolerance_m=tolerance_m, heading_tolerance_deg=tolerance_deg
        )
    except UserError:
        return
    request = goal_request(where.on_the_wire(), 1, Mode.AUTO)
    assert decode(Encoder(1, 1).encode(request)).message == request


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1), st.floats(-50, 50))
def test_body_frame_goal_keeps_its_distance_in_the_world(
    x_m: float, y_m: float, heading_rad: float, ahead_m: float
) -> None:
    there = from_robot(destination([ahead_m, 0.0]), x_m, y_m, heading_rad)
    assert dist((there.x_m, there.y_m), (x_m, y_m)) == pytest.approx(abs(ahead_m), abs=1e-9)
    assert there.heading_rad is None


def test_left_of_a_robot_that_looks_up_is_west() -> None:
    there = from_robot(destination([0.0, 1.0, 90.0]), 3.0, 4.0, pi / 2)
    assert (there.x_m, there.y_m) == pytest.approx((2.0, 4.0))
    assert there.heading_rad is not None
    assert abs(there.heading_rad) == pytest.approx(pi)


ITEMS = (Waypoint(x_m=1.0, y_m=2.0), Waypoint(x_m=6.4, y_m=6.4, heading_deg=45.0))
PLACES = dict(enumerate(ITEMS))


def ended(vehicle: Vehicle = Vehicle.ACTIVE, **changes: object) -> NavigatorStatus:
    """Return the status after a stop on the way to (6.4, 6.4) at 45 degrees."""
    fields = {
        "goal_id": 7,
        "goal_x_m": 6.4,
        "goal_y_m": 6.4,
        "goal_heading_rad": radians(45.0),
        "goal": GoalState.ABORTED,
        "goal_reason": Reason.BUDGET,
    }
    return status(vehicle, **{**fields, **changes})


def mission(
    state: MissionState = MissionState.FAILED, reason: Reason = Reason.BUDGET, current: int = 1
) -> MissionStatus:
    return MissionStatus(
        time_ns=1, mission_id=3, hold_left_ms=0, count=2, current=current, state=state,
        reason=reason,
    )  # fmt: skip


def stage_of(shown: NavigatorStatus, *replies: object, attended: bool = True) -> Stage:
    stage = Stage(Reason.NO_GOAL, *replies, attended=attended)  # type: ignore[arg-type]
    stage.bus.say(STATUS, shown)
    return stage


def test_kept_goal_is_resumed_by_the_robot_itself() -> None:
    stage = Stage(Reason.NONE)
    assert type(perform(Resume(), stage)) is Accepted
    assert len(stage.bus.requests) == 1


@each(
    ("attended", "mode", "sent"),
    [
        (True, Mode.GUIDED, Mode.GUIDED),
        (True, Mode.HOLD, Mode.GUIDED),
        (True, Mode.AUTO, Mode.AUTO),
        (False, Mode.GUIDED, Mode.AUTO),
    ],
)
def test_lost_goal_is_sent_again_as_the_status_shows_it(
    attended: bool, mode: Mode, sent: Mode
) -> None:
    stage = stage_of(ended(mode=mode), attended=attended)
    outcome = perform(Resume(), stage)
    assert isinstance(outcome, Resumed)
    assert outcome.text == "go on to 6.40 6.40 45: ok 14 ms"
    assert outcome.as_json("resume", "r1")["to"] == "6.40 6.40 45"
    goal = stage.bus.requests[-1]
    assert isinstance(goal, GoalRequest)
    assert (goal.x_mm, goal.y_mm, goal.heading_urad) == (6400, 6400, 785398)
    assert (goal.heading_free, goal.mode) == (0, sent)


@each(
    ("vehicle", "reason"),
    [
        (Vehicle.FAILSAFE, Reason.NOT_ARMED),
        (Vehicle.STANDBY, Reason.NOT_ARMED),
        (Vehicle.EMERGENCY_STOP, Reason.EMERGENCY_STOPPED),
    ],
)
def test_robot_that_is_not_armed_gets_no_goal(vehicle: Vehicle, reason: Reason) -> None:
    stage = stage_of(ended(vehicle))
    outcome = perform(Resume(), stage)
    assert isinstance(outcome, Refused)
    assert outcome.reason == reason
    assert [type(one) for one in stage.bus.requests] == [CommandRequest]


def test_a_mode_by_hand_without_an_operator_names_teleop() -> None:
    assert "`sidestep teleop`" in Refused(Reason.NO_OPERATOR, 0).text


@each("goal", [GoalState.NONE, GoalState.REACHED, GoalState.REFUSED])
def test_without_a_lost_goal_there_is_nothing_to_resume(goal: GoalState) -> None:
    outcome = perform(Resume(), stage_of(ended(goal=goal)))
    assert isinstance(outcome, NothingToResume)
    assert outcome.text == "nothing to resume. `sidestep goto X Y` sets a goal"
    keys: dict[int, str] = {Reason.NO_GOAL: "`g` sets a goal"}
    assert outcome.in_words(keys) == "nothing to resume. `g` sets a goal"
    assert outcome.as_json("resume", "r1")["reason_code"] == Reason.NO_GOAL


def test_resume_says_how_a_mission_begins_that_a_restarted_robot_has_restored() -> None:
    stage = stage_of(ended(goal=GoalState.NONE))
    stage.bus.say(MISSION, mission(MissionState.READY, Reason.NONE, 0))
    assert perform(Resume(), stage).text == (
        "nothing to resume: the mission has not been started: `mission start` begins it at"
        " item 1 of 2"
    )


def test_resume_of_a_mission_continues_it_and_not_the_goal_that_came_since() -> None:
    stage = Stage()
    stage.bus.say(STATUS, ended(mode=Mode.HOLD, goal=GoalState.DRIVING))
    stage.bus.say(MISSION, mission(reason=Reason.REPLACED))
    outcome = perform(ResumeMission(), stage)
    assert outcome.text.startswith("go on to mission item 2 of 2: ok")
    sent = stage.bus.requests[-1]
    assert (sent.command, sent.param1) == (Command.MISSION_START, -1.0)


@each("state", [MissionState.PAUSED, MissionState.RUNNING, MissionState.HOLDING])
def test_mission_that_is_paused_is_resumed_by_the_robot_itself(state: MissionState) -> None:
    stage = Stage()
    stage.bus.say(MISSION, mission(state, Reason.BY_OPERATOR))
    assert type(perform(ResumeMission(), stage)) is Accepted
    sent = stage.bus.requests[-1]
    assert (sent.command, sent.param1) == (Command.DO_PAUSE_CONTINUE, 1.0)


@each(
    ("state", "words"),
    [
        (MissionState.READY, "the mission has not been started: `mission start` begins it at"),
        (MissionState.DONE, "the mission is done: `mission start` begins it again"),
        (MissionState.NONE, "there is no mission to act on"),
    ],
)
def test_mission_that_is_not_under_way_is_not_resumed(state: MissionState, words: str) -> None:
    stage = Stage()
    stage.bus.say(MISSION, mission(state, Reason.NONE, 0))
    outcome = perform(ResumeMission(), stage)
    assert (outcome.ok, words in outcome.text) == (False, True)
    assert stage.bus.requests == []


def test_mission_continues_at_its_item() -> None:
    items = list(items_of(ITEMS))
    count = MissionCount(count=2, mission_type=MissionType.MISSION)
    stage = stage_of(ended(), count, *items, Reason.NONE)
    stage.bus.say(MISSION, mission())
    outcome = perform(Resume(), stage)
    assert isinstance(outcome, Resumed)
    assert outcome.text.startswith("go on to mission item 2 of 2: ok")
    sent = stage.bus.requests[-1]
    assert (sent.command, sent.param1) == (Command.MISSION_START, -1.0)
    assert MISSION_SERVICE.path in [path for _, path, _ in stage.bus.asked]


def test_goal_after_a_failed_mission_is_not_the_mission() -> None:
    assert lost_drive(ended(), mission(current=1), PLACES) == LostMission(1, 2)
    assert isinstance(lost_drive(ended(goal_x_m=3.0), mission(current=1), PLACES), LostGoal)
    assert isinstance(lost_drive(ended(), mission(current=0), PLACES), LostGoal)
    assert isinstance(lost_drive(ended(), mission(reason=Reason.REPLACED), PLACES), LostGoal)
    assert isinstance(lost_drive(ended(), mission(MissionState.DONE), PLACES), LostGoal)
    assert isinstance(lost_drive(ended(), mission(), {}), LostGoal)


def test_mission_that_waited_at_an_item_is_lost_too() -> None:
    assert lost_drive(ended(goal=GoalState.REACHED), mission(), PLACES) == LostMission(1, 2)


def test_return_is_continued_as_a_return() -> None:
    stage = stage_of(ended(mode=Mode.SMART_RTL), Reason.NONE)
    outcome = perform(Resume(), stage)
    assert isinstance(outcome, Resumed)
    assert isinstance(outcome.drive, LostReturn)
    assert stage.bus.requests[-1].command == Command.NAV_RETURN_TO_LAUNCH


def test_goal_without_a_heading_stays_without_one() -> None:
    found = lost_drive(ended(goal_heading_rad=nan), None, {})
    assert found == LostGoal(Destination(x_m=6.4, y_m=6.4, heading_rad=None), is_auto=False)
    assert str(found) == "6.40 6.40"
    assert lost_drive(ended(goal_x_m=nan), None, {}) is None


GOAL = destination([1.0, 2.0, 90.0])
FRESH_NS = 2_000_000_000
ABORT = Command.SIDESTEP_ABORT_GOAL
REACHED_LATER = {"goal": GoalState.REACHED, "time_ns": 3}


def kinds(stage: Stage) -> list[str]:
    return [name_of(request) for request in stage.bus.requests]


def name_of(request: Message) -> str:
    if isinstance(request, LeaseRequest):
        return LeaseAction(request.action).name
    if isinstance(request, GoalRequest):
        return Mode(request.mode).name
    assert isinstance(request, CommandRequest)
    return Command(request.command).name


def following(stage: Stage, *ends: Any) -> None:
    """Let the robot publish these statuses of the goal, one at each poll."""
    waiting, sleep_until = list(ends), stage.clock.sleep_until

    def publish(deadline_ns: int) -> None:
        goals = [one for one in stage.bus.requests if isinstance(one, GoalRequest)]
        if goals and waiting and (polls := list(stage.robot._arrivals)):
            found = waiting.pop(0)
            if isinstance(found, BaseException):
                polls[0].set_exception(found)
            else:
                stage.bus.say(STATUS, status(goal_id=goals[-1].request_id, **found))
        sleep_until(deadline_ns)

    stage.clock.sleep_until = publish  # type: ignore[method-assign]


def test_goal_is_followed_to_its_end_under_the_lease() -> None:
    stage = Stage()
    driving = {"goal": GoalState.DRIVING, "time_ns": 2}
    following(stage, driving, {"goal": GoalState.REACHED, "time_ns": 3})
    outcome = perform(Goto(goal=GOAL), stage)
    assert isinstance(outcome, GoalEnded)
    assert (outcome.ok, outcome.outcome, outcome.distance_m) == (True, "reached", 1.5)
    assert kinds(stage) == ["TAKE", "GUIDED", "LEAVE"]
    assert any("goal (1.000, 2.000) at 90.0 deg accepted" in note for note in stage.notes.notes)


def test_standing_robot_is_armed_first() -> None:
    stage = Stage(Reason.NONE, Reason.NOT_ARMED, Reason.NONE, Reason.NONE)
    stage.bus.say(*STANDBY)
    following(stage, {"goal": GoalState.REACHED, "time_ns": 3})
    assert perform(Goto(goal=GOAL), stage).ok
    assert kinds(stage) == ["TAKE", "GUIDED", "COMPONENT_ARM_DISARM", "GUIDED", "LEAVE"]
    assert stage.notes.notes[0] == "armed"


@each("attended", [True, False])
def test_goal_that_may_not_arm_is_refused(attended: bool) -> None:
    replies = [Reason.NOT_ARMED] if attended else [Reason.NONE, Reason.NOT_ARMED]
    stage = Stage(*replies, attended=attended)
    stage.bus.say(*STANDBY)
    outcome = perform(Goto(goal=GOAL, arms=False), stage)
    assert isinstance(outcome, Refused)
    assert outcome.reason == Reason.NOT_ARMED
    assert "COMPONENT_ARM_DISARM" not in kinds(stage)


def test_refused_goal_is_the_outcome_and_the_lease_goes_back() -> None:
    stage = Stage(Reason.NONE, Reason.OUTSIDE_FENCE)
    outcome = perform(Goto(goal=GOAL), stage)
    assert isinstance(outcome, Refused)
    assert outcome.reason == Reason.OUTSIDE_FENCE
    assert kinds(stage) == ["TAKE", "GUIDED", "LEAVE"]


def test_lease_of_another_operator_ends_it_before_the_goal() -> None:
    stage = Stage(Reason.LEASE_HELD)
    stage.bus.say(*HELD)
    with pytest.raises(RefusedError, match="anna"):
        perform(Goto(goal=GOAL), stage)
    assert kinds(stage) == ["TAKE"]


@each("error", [CancelledError(), RuntimeError("a defect")])
def test_whatever_interrupts_it_aborts_the_goal(error: BaseException) -> None:
    stage = Stage()
    following(stage, {"goal": GoalState.DRIVING, "time_ns": 2}, error)
    with pytest.raises(type(error)):
        perform(Goto(goal=GOAL), stage)
    assert kinds(stage) == ["TAKE", "GUIDED", "SIDESTEP_ABORT_GOAL", "LEAVE"]


def ended_id(stage: Stage) -> int:
    """Return the goal that the last abort ends; every abort must name one."""
    aborts = [one for one in stage.bus.requests if getattr(one, "command", 0) == ABORT]
    assert all(one.ends_id for one in aborts)
    return int(aborts[-1].ends_id)


def goal_id(stage: Stage) -> int:
    return [one.request_id for one in stage.bus.requests if isinstance(one, GoalRequest)][-1]


def test_interrupted_goal_aborts_itself_and_no_other() -> None:
    """The goal that was accepted at last is named, not one that was refused before."""
    stage = Stage(Reason.NONE, Reason.NOT_ARMED)
    stage.bus.say(*STANDBY)
    following(stage, {"goal": GoalState.DRIVING, "time_ns": 2}, CancelledError())
    with pytest.raises(CancelledError):
        perform(Goto(goal=GOAL), stage)
    assert ended_id(stage) == goal_id(stage)
    assert stage.notes.notes[-1] == "interrupted: goal aborted, the robot stops"


def test_abort_of_a_goal_that_is_over_says_nothing() -> None:
    stage = Stage(Reason.NONE, Reason.NONE, Reason.ALREADY_OVER)
    following(stage, {"goal": GoalState.DRIVING, "time_ns": 2}, CancelledError())
    with pytest.raises(CancelledError):
        perform(Goto(goal=GOAL), stage)
    assert kinds(stage)[-2:] == ["SIDESTEP_ABORT_GOAL", "LEAVE"]
    assert "abort" not in stage.notes.notes[-1]


def test_goal_that_another_one_replaces_is_replaced_and_aborts_nothing() -> None:
    stage = Stage()
    driving = {"goal": GoalState.DRIVING, "time_ns": 2}
    following(stage, driving, {"goal": GoalState.DRIVING, "time_ns": 3})
    sleep_until = stage.clock.sleep_until

    def publish(deadline_ns: int) -> None:
        sleep_until(deadline_ns)
        if stage.clock.now_ns() > 2_000_000_000:
            other = status(goal_id=4, goal=GoalState.DRIVING, time_ns=9, goal_x_m=1.3, goal_y_m=2.0)
            stage.bus.say(STATUS, other)
            stage.bus.say(LEASE, replace(lease_of("ben"), drive_id=4, driver="ben@desk:p/2"))

    stage.clock.sleep_until = publish  # type: ignore[method-assign]
    outcome = perform(Goto(goal=GOAL), stage)
    assert isinstance(outcome, GoalEnded)
    assert not outcome.ok
    assert outcome.text.startswith("replaced by the goal 1.3 2.0 of ben@desk:p/2 after ")
    assert outcome.as_json("goto", "r1")["outcome"] == "replaced"
    assert kinds(stage) == ["TAKE", "GUIDED", "LEAVE"]


@each(
    ("goal", "reason", "outcome"),
    [
        (GoalState.REACHED, Reason.NONE, "reached"),
        (GoalState.STUCK, Reason.NO_PROGRESS, "stuck"),
        (GoalState.ABORTED, Reason.BY_OPERATOR, "aborted: no message from the robot for 3.0 s"),
    ],
)
def test_goal_that_had_ended_unheard_ends_as_it_did(
    goal: GoalState, reason: Reason, outcome: str
) -> None:
    """The robot is heard again while its goal is aborted."""
    stage = Stage()
    following(stage, {"goal": GoalState.DRIVING, "time_ns": 2})

    def heard_again(_number: int) -> None:
        if kinds(stage)[-1] == "SIDESTEP_ABORT_GOAL":
            shown = status(time_ns=9, goal=goal, goal_reason=reason, goal_id=goal_id(stage))
            stage.bus.say(STATUS, shown)

    stage.bus.on_ask = heard_again
    ended = perform(Goto(goal=GOAL), stage)
    assert isinstance(ended, GoalEnded)
    assert ended.text.startswith(outcome)


def test_nothing_is_shown_until_the_robot_has_the_goal() -> None:
    stage = Stage()
    stage.bus.say(STATUS, status(goal_id=4, goal=GoalState.REACHED))
    following(stage, {"goal": GoalState.DRIVING, "time_ns": 2}, REACHED_LATER)
    stage.notes.live = True
    assert perform(Goto(goal=GOAL), stage).ok
    assert stage.notes.lines
    assert not [line for line in stage.notes.lines if "waiting" in line]


def test_goal_whose_answers_were_lost_is_aborted() -> None:
    stage = Stage(Reason.NONE, None, None, None)
    with pytest.raises(RemoteError):
        perform(Goto(goal=GOAL), stage)
    assert ended_id(stage) == goal_id(stage)
    assert kinds(stage)[-2:] == ["SIDESTEP_ABORT_GOAL", "LEAVE"]


def test_goal_that_takes_too_long_is_aborted() -> None:
    stage = Stage()
    times = range(2, 200)
    following(stage, *({"goal": GoalState.DRIVING, "time_ns": at} for at in times))
    outcome = perform(Goto(goal=GOAL, timeout_s=1.0), stage)
    assert isinstance(outcome, GoalEnded)
    assert (outcome.ok, outcome.outcome, outcome.reason) == (
        False,
        "timeout",
        "goal not reached within 1 s",
    )
    assert kinds(stage)[-2:] == ["SIDESTEP_ABORT_GOAL", "LEAVE"]


def test_silent_robot_ends_the_goal() -> None:
    outcome = perform(Goto(goal=GOAL), Stage())
    assert isinstance(outcome, GoalEnded)
    assert outcome.outcome == "aborted"
    assert "no message" in outcome.reason


def test_attended_goal_ends_with_the_answer() -> None:
    stage = Stage(attended=True)
    assert perform(Goto(goal=GOAL), stage).text == "ok 14 ms"
    assert kinds(stage) == ["GUIDED"]


def test_goal_that_needs_no_operator_is_in_auto() -> None:
    stage = Stage()
    assert perform(Goto(goal=GOAL, wait=False), stage).ok
    assert (kinds(stage), stage.bus.sent) == (["AUTO"], [])


@each(("wait", "attended"), [(False, False), (True, True)])
def test_timeout_is_refused_without_waiting(wait: bool, attended: bool) -> None:
    stage = Stage(attended=attended)
    with pytest.raises(UserError, match="--timeout"):
        perform(Goto(goal=GOAL, wait=wait, timeout_s=3.0), stage)
    assert stage.bus.asked == []


def test_goal_ahead_of_a_robot_without_a_pose_is_not_sent() -> None:
    stage = Stage()
    with pytest.raises(RemoteError, match="publishes no pose"):
        perform(Goto(goal=GOAL, seen_by_robot=True, wait=False), stage)
    assert stage.bus.asked == []


def test_robot_in_a_failsafe_is_never_armed_by_a_goal() -> None:
    stage = Stage(Reason.NOT_ARMED, attended=True)
    stage.bus.say(STATUS, status(Vehicle.FAILSAFE))
    assert not perform(Goto(goal=GOAL), stage).ok
    assert kinds(stage) == ["GUIDED"]


BOX = Floor("box", 6.0, 4.0)
GOAL_JSON = {"x_m": 5.0, "y_m": 2.0, "heading_deg": None}
GOAL_JSON |= {"position_tolerance_m": 0.05, "heading_tolerance_deg": 3.0}
START_JSON = {"x_m": 0.6, "y_m": 2.0, "heading_deg": 0.0}
FACTS = {"name": "box", "size_m": [6.0, 4.0], "start": START_JSON, "obstacles": []}
WITH_GOAL = json.dumps({**FACTS, "goal": GOAL_JSON}).encode()
WITHOUT_GOAL = json.dumps(FACTS).encode()


def attended(*script: Reply, floor: Floor | None = BOX) -> Stage:
    """Return a stage that knows the floor of its world."""
    stage = Stage(*script, attended=True)
    stage.floor = floor
    return stage


def floor_at(stage: Stage) -> Floor | None:
    return floor_of(stage.bus, "r1")


@each("place", [(100.0, 100.0), (-0.01, 1.0), (1.0, 4.01), (6.01, 1.0)])
def test_goal_outside_the_world_is_not_sent(place: tuple[float, float]) -> None:
    stage = attended()
    with pytest.raises(UserError, match=r"outside the world box \(6 x 4 m\); --anyway"):
        perform(Goto(goal=destination([*place])), stage)
    assert stage.bus.requests == []


@each("place", [(0.0, 0.0), (6.0, 4.0), (3.0, 2.0)])
def test_goal_inside_the_world_is_sent(place: tuple[float, float]) -> None:
    assert perform(Goto(goal=destination([*place])), attended()).ok


def test_goal_outside_the_world_may_be_sent_anyway() -> None:
    stage = attended()
    assert perform(Goto(goal=destination([100.0, 1.0]), anyway=True), stage).ok
    assert isinstance(stage.bus.requests[-1], GoalRequest)


@each(
    ("place", "refused"),
    [((2.5, 1.4), True), ((2.1, 1.9), False), ((4.2, 3.0), True), ((4.2, 3.2), False),
     ((1.0, 1.0), False), ((1.0, 3.0), False)],
)  # fmt: skip
def test_goal_in_an_obstacle_is_not_sent(place: tuple[float, float], refused: bool) -> None:
    stage = attended(floor=floor_in(WORLD_TEXT))
    goal, words = destination([*place]), r"lies in an obstacle of the world box; --anyway"
    if refused:
        with pytest.raises(UserError, match=words):
            perform(Goto(goal=goal), stage)
        assert stage.bus.requests == []
    assert perform(Goto(goal=goal, anyway=refused), stage).ok


def test_without_a_known_world_the_robot_decides() -> None:
    assert perform(Goto(goal=destination([100.0, 1.0])), attended(floor=None)).ok


def test_mission_names_the_waypoint_outside_the_world() -> None:
    stage = attended()
    inside, outside = Waypoint(x_m=1.0, y_m=1.0), Waypoint(x_m=1.0, y_m=9.0)
    mission = Mission(waypoints=(inside, outside))
    with pytest.raises(UserError, match=r"waypoint 2 \(1, 9\) lies outside the world box"):
        perform(UploadMission(mission=mission), stage)
    assert stage.bus.requests == []


def test_floor_is_read_from_the_plant() -> None:
    assert floor_at(Stage(WITH_GOAL)) == BOX


def test_goto_without_a_place_drives_to_the_goal_of_the_world() -> None:
    stage = attended(WITH_GOAL)
    assert perform(Goto(), stage).ok
    request = stage.bus.requests[-1]
    assert isinstance(request, GoalRequest)
    place = destination([5.0, 2.0]).on_the_wire()
    assert request == goal_request(place, request.request_id, Mode.GUIDED)


@each("answer", [WITHOUT_GOAL, None, b"{}", b"[]", b"\xff"])
def test_goto_without_a_place_needs_a_world_with_a_goal(answer: bytes | None) -> None:
    stage = attended(answer)
    with pytest.raises(
        UserError, match="X Y is missing, and there is no simulation with a goal; example"
    ):
        perform(Goto(), stage)
    assert not any(isinstance(one, GoalRequest) for one in stage.bus.requests)


def test_goal_of_the_world_is_not_that_of_a_further_robot() -> None:
    stage = attended(WITH_GOAL)
    stage.robot = stage.robot.to("r2")
    with pytest.raises(UserError, match="is that of r1; example: goto"):
        perform(Goto(), stage)


@each("words", ["1", "--frame body", "--tol 0.2"])
def test_part_of_a_goal_is_refused_with_an_example(words: str) -> None:
    with pytest.raises(UserError, match="example: goto 2"):
        command_in(parse(["goto", *words.split()]))


def test_plant_that_does_not_answer_knows_no_world() -> None:
    assert floor_at(Stage(None)) is None


@each(
    "text",
    [
        b"",
        b"[]",
        b'{"name": 1}',
        b'{"name": 1, "size_m": [1]}',
        b"\xff",
        b'{"name": 1, "size_m": [1, 2], "obstacles": [{"circle_m": {}}]}',
        "{}",
    ],
)
def test_malformed_description_has_no_floor(text: bytes | str) -> None:
    assert floor_in(text) is None
