"""The pose of a robot is set by an operator, or from a simulation's truth by an explicit action."""

from math import inf, isnan, nan, radians

import pytest

from ground.client.goal import destination
from ground.client.operations.floor import Floor, floor_in
from ground.client.operations.goals import Goto
from ground.client.operations.place import SetPose, SetTruePose
from ground.client.operations.session import Session
from ground.client.results import Accepted, Refused
from ground.client.status_line import knows_place, pose_of
from protocol.topics import ODOMETRY, TRUTH
from protocol.wire.enums import Command
from protocol.wire.messages import CommandRequest, GoalRequest
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError, UserError
from tests.support.each import each
from tests.support.ground.client import Stage
from tests.support.ground.station.play import WORLD_TEXT
from tests.support.ground.station.said import Robot


def sent(stage: Stage) -> CommandRequest:
    (request,) = stage.bus.requests
    assert isinstance(request, CommandRequest)
    assert request.command == Command.SIDESTEP_SET_POSE
    return request


def test_pose_is_sent_in_metres_and_radians() -> None:
    stage = Stage()
    assert SetPose(x_m=1.5, y_m=-2.0, heading_deg=90.0).perform(stage.session).ok
    request = sent(stage)
    assert (request.param1, request.param2) == (1.5, -2.0)
    assert request.param3 == pytest.approx(radians(90.0))


def test_pose_without_a_heading_leaves_the_heading_open() -> None:
    stage = Stage()
    SetPose(x_m=1.0, y_m=2.0).perform(stage.session)
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
    session = Session(stage.link, floor=lambda: floor_in(WORLD_TEXT))
    with pytest.raises(UserError, match=rf"pose \({x_m:.3f}, 1.400\) lies .*{words}.*; --anyway"):
        SetPose(x_m=x_m, y_m=1.4).perform(session)
    assert stage.bus.requests == []
    assert SetPose(x_m=x_m, y_m=1.4, anyway=True).perform(session).ok
    assert sent(stage).param1 == x_m


def test_pose_inside_the_world_is_set() -> None:
    stage = Stage()
    session = Session(stage.link, floor=lambda: floor_in(WORLD_TEXT))
    assert SetPose(x_m=1.0, y_m=1.0).perform(session).ok
    assert sent(stage).param1 == 1.0


def test_truth_of_the_plant_becomes_the_pose() -> None:
    stage = Stage()
    stage.bus.set_newest(TRUTH, Robot(x_m=2.5).truth())
    assert isinstance(SetTruePose().perform(stage.session), Accepted)
    request = sent(stage)
    assert (request.param1, request.param2, request.param3) == (2.5, 0.0, 0.0)


def test_without_a_simulation_there_is_no_truth() -> None:
    stage = Stage()
    with pytest.raises(RemoteError, match="use `pose set X Y DEG`"):
        SetTruePose().perform(stage.session)
    assert stage.bus.requests == []


def test_refused_goal_names_the_command_that_sets_the_place() -> None:
    outcome = Goto(goal=destination([1.0, 2.0]), wait=False).perform(
        Stage(Reason.PLACE_UNKNOWN).session
    )
    assert isinstance(outcome, Refused)
    assert "does not know where it is" in outcome.text
    assert "pose set X Y DEG" in outcome.text


@each("seen_by_robot", [True, False])
def test_goal_says_that_it_was_given_relative_to_the_robot(seen_by_robot: bool) -> None:
    stage = Stage()
    stage.bus.set_newest(ODOMETRY, Robot(placed=False).odometry())
    goto = Goto(goal=destination([1.0, 0.0]), seen_by_robot=seen_by_robot, wait=False)
    assert goto.perform(stage.session).ok
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
    stage.bus.set_newest(ODOMETRY, Robot(x_m=3.0, placed=placed).odometry())
    session = Session(stage.session.link, floor=lambda: Floor("box", 6.0, 4.0))
    goto = Goto(goal=destination([4.0, 0.0]), seen_by_robot=True, wait=False, anyway=anyway)
    if placed and not anyway:
        with pytest.raises(UserError, match=r"goal \(7\.000, 0\.000\) lies outside the world box"):
            goto.perform(session)
        assert stage.bus.requests == []
    else:
        assert goto.perform(session).ok
