"""The vehicle reports an unknown place, and takes its pose from an operator."""

from math import isnan, nan, pi

import pytest

from ground.text.wording import StatustextAssembler
from protocol.wire.enums import Command, Severity
from protocol.wire.messages import CommandAck, GoalRequest
from protocol.wire.reasons import Reason, reason_text
from robot import telemetry
from robot.core.parameters import DEFAULTS
from robot.core.values import Pose
from robot.storage import Store
from robot.vehicle import Vehicle
from tests.support.robot.vehicles import Desk, goal


def restarted() -> Desk:
    """Return a robot whose wheels had turned before its process started, after one tick."""
    desk = Desk()
    desk.left = desk.right = 5000.0
    desk.step()
    return desk


def texts(desk: Desk) -> list[tuple[int, str]]:
    assembler = StatustextAssembler()
    whole = [(text.severity, assembler.receive(text)) for text in desk.vehicle.texts()]
    return [(severity, words) for severity, words in whole if words]


def set_pose(desk: Desk, x_m: float, y_m: float, heading_rad: float) -> int:
    return desk.command(Command.SIDESTEP_SET_POSE, x_m, y_m, heading_rad)


def from_robot(request: GoalRequest) -> GoalRequest:
    values = {name: getattr(request, name) for name in request.__struct_fields__}
    return GoalRequest(**(values | {"from_robot": 1}))


def test_restarted_robot_says_that_its_place_is_unknown_once() -> None:
    desk = restarted()
    words = f"PLACE UNKNOWN: {reason_text(Reason.PLACE_UNKNOWN)}"
    assert (Severity.ERROR, words) in texts(desk)
    desk.step()
    assert texts(desk) == []


def test_robot_at_its_start_reports_no_unknown_place() -> None:
    desk = Desk()
    desk.step()
    assert not [words for _, words in texts(desk) if "PLACE" in words]


def test_covariance_without_a_place_is_not_a_number() -> None:
    desk = restarted()
    odometry = telemetry.odometry(desk.vehicle.state, 0)
    spread = [getattr(odometry, name) for name in odometry.__struct_fields__ if "cov" in name]
    assert len(spread) == 6
    assert all(isnan(value) for value in spread)
    assert (odometry.x_m, odometry.y_m, odometry.heading_rad) == (0.0, 0.0, 0.0)
    assert set_pose(desk, 1.0, 2.0, 0.5) == Reason.NONE
    odometry = telemetry.odometry(desk.vehicle.state, 0)
    assert 0.0 < odometry.cov_xx_m2 < 1e-6
    assert (odometry.x_m, odometry.y_m) == (1.0, 2.0)


def test_goal_is_refused_until_the_place_is_set() -> None:
    desk = restarted()
    assert desk.arm() == Reason.NONE
    assert desk.goto(2, 0) == Reason.PLACE_UNKNOWN
    assert desk.command(Command.NAV_RETURN_TO_LAUNCH) == Reason.PLACE_UNKNOWN
    assert set_pose(desk, 0.5, 0.0, 0.0) == Reason.NONE
    assert desk.goto(2, 0) == Reason.NONE


def test_goal_relative_to_the_robot_is_accepted_without_a_place() -> None:
    desk = restarted()
    desk.arm()
    answer = desk.vehicle.receive(from_robot(goal(99, 1.0, 0.0)), desk.now_ns)
    assert isinstance(answer, CommandAck)
    assert answer.result_param2 == Reason.NONE


def test_set_pose_is_announced_and_acknowledged_as_itself() -> None:
    desk = restarted()
    texts(desk)
    assert set_pose(desk, 1.25, -2.5, pi / 2) == Reason.NONE
    assert (Severity.NOTICE, "place set: 1.25 -2.50 m, 90 deg") in texts(desk)
    assert set_pose(desk, nan, 0.0, 0.0) == Reason.PARAMETER_OUT_OF_RANGE
    assert texts(desk) == []


def test_heading_that_is_not_given_stays() -> None:
    desk = Desk()
    desk.step()
    assert set_pose(desk, 1.0, 1.0, 0.75) == Reason.NONE
    assert set_pose(desk, 2.0, 1.0, nan) == Reason.NONE
    x_m, y_m, heading_rad = desk.vehicle.state.odometry.pose
    assert (x_m, y_m) == (2.0, 1.0)
    assert heading_rad == pytest.approx(0.75)


def test_restarted_plant_makes_the_place_unknown() -> None:
    desk = Desk()
    desk.arm()
    desk.goto(2, 0)
    desk.vehicle.lose_position(desk.now_ns)
    assert desk.vehicle.state.machine.vehicle_reason == Reason.TICKS_LOST
    desk.step()
    assert desk.arm() == Reason.NONE
    assert desk.goto(2, 0) == Reason.PLACE_UNKNOWN
    assert [words for _, words in texts(desk) if words.startswith("PLACE UNKNOWN")]


def test_totals_of_the_start_are_given_with_it() -> None:
    vehicle = Vehicle(DEFAULTS, Store(None), Pose(1.0, 2.0, 0.0), totals=(5000, 5000))
    desk = Desk()
    desk.vehicle = vehicle
    desk.left = desk.right = 5000.0
    desk.step()
    assert vehicle.state.machine.placed
    assert vehicle.state.odometry.pose == Pose(1.0, 2.0, 0.0)
