"""Resume drives on to what a stop has ended, as the robot's own status shows it."""

from math import nan, radians

from ground.client.goal import Destination
from ground.client.operations.commands import Resume
from ground.client.operations.lost_drive import (
    LostGoal,
    LostMission,
    LostReturn,
    lost_drive,
)
from ground.client.operations.resuming import NothingToResume, Resumed
from ground.client.results import Accepted, Refused
from ground.missions.mission import Waypoint
from ground.missions.transfer import items_of
from protocol.topics import MISSION, MISSION_SERVICE, STATUS
from protocol.wire.enums import Command, GoalState, MissionState, MissionType, Mode, Vehicle
from protocol.wire.messages import (
    CommandRequest,
    GoalRequest,
    MissionCount,
    MissionStatus,
    NavigatorStatus,
)
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.ground.client import Stage, status

ITEMS = (Waypoint(x_m=1.0, y_m=2.0), Waypoint(x_m=6.4, y_m=6.4, heading_deg=45.0))


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
    stage.bus.set_newest(STATUS, shown)
    return stage


def test_kept_goal_is_resumed_by_the_robot_itself() -> None:
    stage = Stage(Reason.NONE)
    assert type(Resume().perform(stage.session)) is Accepted
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
    outcome = Resume().perform(stage.session)
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
    outcome = Resume().perform(stage.session)
    assert isinstance(outcome, Refused)
    assert outcome.reason == reason
    assert [type(one) for one in stage.bus.requests] == [CommandRequest]


@each("goal", [GoalState.NONE, GoalState.REACHED, GoalState.REFUSED])
def test_without_a_lost_goal_there_is_nothing_to_resume(goal: GoalState) -> None:
    outcome = Resume().perform(stage_of(ended(goal=goal)).session)
    assert isinstance(outcome, NothingToResume)
    assert outcome.text == "nothing to resume. `goto X Y` sets a goal"
    keys: dict[int, str] = {Reason.NO_GOAL: "`g` sets a goal"}
    assert outcome.in_words(keys) == "nothing to resume. `g` sets a goal"
    assert outcome.as_json("resume", "r1")["reason_code"] == Reason.NO_GOAL


def test_mission_continues_at_its_item() -> None:
    items = list(items_of(ITEMS))
    count = MissionCount(count=2, mission_type=MissionType.MISSION)
    stage = stage_of(ended(), count, *items, Reason.NONE)
    stage.bus.set_newest(MISSION, mission())
    outcome = Resume().perform(stage.session)
    assert isinstance(outcome, Resumed)
    assert outcome.text.startswith("go on to mission item 2 of 2: ok")
    sent = stage.bus.requests[-1]
    assert (sent.command, sent.param1) == (Command.MISSION_START, -1.0)
    assert MISSION_SERVICE.path in [path for path, _ in stage.bus.asked]


def test_goal_after_a_failed_mission_is_not_the_mission() -> None:
    assert lost_drive(ended(), mission(current=1), ITEMS) == LostMission(1, 2)
    assert isinstance(lost_drive(ended(goal_x_m=3.0), mission(current=1), ITEMS), LostGoal)
    assert isinstance(lost_drive(ended(), mission(current=0), ITEMS), LostGoal)
    assert isinstance(lost_drive(ended(), mission(reason=Reason.REPLACED), ITEMS), LostGoal)
    assert isinstance(lost_drive(ended(), mission(MissionState.DONE), ITEMS), LostGoal)
    assert isinstance(lost_drive(ended(), mission(), ()), LostGoal)


def test_mission_that_waited_at_an_item_is_lost_too() -> None:
    assert lost_drive(ended(goal=GoalState.REACHED), mission(), ITEMS) == LostMission(1, 2)


def test_return_is_continued_as_a_return() -> None:
    stage = stage_of(ended(mode=Mode.SMART_RTL), Reason.NONE)
    outcome = Resume().perform(stage.session)
    assert isinstance(outcome, Resumed)
    assert isinstance(outcome.drive, LostReturn)
    assert stage.bus.requests[-1].command == Command.NAV_RETURN_TO_LAUNCH


def test_goal_without_a_heading_stays_without_one() -> None:
    found = lost_drive(ended(goal_heading_rad=nan), None, ())
    assert found == LostGoal(Destination(x_m=6.4, y_m=6.4, heading_rad=None), is_auto=False)
    assert str(found) == "6.40 6.40"
    assert lost_drive(ended(goal_x_m=nan), None, ()) is None
