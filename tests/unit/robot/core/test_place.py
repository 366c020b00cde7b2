"""A robot knows its place from the start or from an operator, and refuses the world otherwise."""

from math import inf, nan, pi

import pytest

from robot.core import modes, place, reasons, states
from robot.core.motion import Trail
from robot.core.parameters import DEFAULTS
from robot.core.perception.odometry import Odometry
from robot.core.safety.fence import Fence
from robot.core.values import Pose, Wheels
from tests.support.cores import AHEAD, Driven, armed, driving
from tests.support.each import each

AROUND = Fence((0.0,), (0.0,), 5.0)
GIVEN = Pose(1.5, -2.0, 0.5)
COVARIANCES = ("pxx", "pxy", "pxh", "pyy", "pyh", "phh")


def restarted(left: float = 1200, right: float = 1100) -> Driven:
    """Return a robot whose wheels have turned before its process started, after one tick."""
    driven = Driven()
    driven.left, driven.right = left, right
    driven.tick()
    return driven


def rearmed() -> Driven:
    """Return the same robot armed."""
    driven = restarted()
    assert modes.arm(driven.machine) == reasons.OK
    return driven


def spread(odometry: Odometry) -> list[float]:
    return [getattr(odometry, name) for name in COVARIANCES]


def test_robot_at_its_start_knows_its_place() -> None:
    driven = driving()
    assert driven.machine.placed


@each("totals", [(1, 0), (0, 1), (-7, 0), (0, -7), (500, 500)])
def test_wheels_that_have_turned_make_the_place_unknown(totals: tuple[int, int]) -> None:
    assert not restarted(*totals).machine.placed


def test_totals_given_with_the_start_pose_belong_to_it() -> None:
    driven = Driven()
    driven.left = driven.right = 2**31 - 5
    driven.state.odometry.left = driven.state.odometry.right = 2**31 - 5
    driven.tick()
    assert driven.machine.placed


def test_place_is_judged_by_the_first_sample_only() -> None:
    driven = Driven()
    driven.has_wheels = False
    driven.tick()
    assert driven.machine.placed
    driven.has_wheels, driven.left = True, 3
    driven.tick()
    assert not driven.machine.placed
    driven.left = 0
    driven.tick()
    assert not driven.machine.placed


def test_goals_in_the_world_are_refused_without_a_place() -> None:
    driven = rearmed()
    assert driven.goto() == reasons.PLACE_UNKNOWN
    machine = driven.machine
    assert (machine.goal_state, machine.goal_reason) == (states.REFUSED, reasons.PLACE_UNKNOWN)
    driven.forward(0.5)
    assert driven.stands


def test_goal_relative_to_the_robot_needs_no_place() -> None:
    driven = rearmed()
    assert modes.goto(driven.machine, AHEAD, states.AUTO, 0, from_robot=True) == reasons.OK
    driven.forward(0.5)
    assert not driven.stands


def test_goal_from_the_robot_is_checked_like_any_other() -> None:
    driven = restarted()
    goal = AHEAD
    assert modes.goto(driven.machine, goal, states.AUTO, 0, from_robot=True) == reasons.NOT_ARMED


def test_way_back_is_refused_without_a_place() -> None:
    driven = rearmed()
    assert modes.rtl(driven.machine, driven.state.trail, 0) == reasons.PLACE_UNKNOWN
    mode = modes.set_mode(driven.machine, driven.state.trail, states.SMART_RTL, 0)
    assert mode == reasons.PLACE_UNKNOWN


def test_manual_driving_needs_no_place() -> None:
    driven = rearmed()
    assert modes.set_mode(driven.machine, driven.state.trail, states.MANUAL, 0) == reasons.OK


def test_fence_needs_a_place_and_may_always_be_lifted() -> None:
    driven = restarted()
    pose = driven.state.odometry.pose
    assert modes.set_fence(driven.machine, AROUND, pose) == reasons.PLACE_UNKNOWN
    assert driven.machine.fence is None
    assert modes.set_fence(driven.machine, None, pose) == reasons.OK


def test_restored_fence_forbids_arming_without_a_place() -> None:
    driven = Driven()
    driven.left = 900
    assert modes.set_fence(driven.machine, AROUND, Pose(0.0, 0.0, 0.0)) == reasons.OK
    driven.tick()
    assert modes.arm(driven.machine) == reasons.FENCE_UNCHECKED
    assert place.set_pose(driven.state, GIVEN) == reasons.OK
    driven.tick()
    assert modes.arm(driven.machine) == reasons.OK


def test_armed_robot_with_a_fence_stops_when_its_place_is_lost() -> None:
    driven = driving()
    driven.machine.fence = AROUND
    driven.machine.placed = False
    driven.tick()
    assert driven.machine.vehicle_reason == reasons.FENCE_UNCHECKED
    assert driven.machine.goal_reason == reasons.FENCE_UNCHECKED


def test_given_pose_is_as_certain_as_the_start() -> None:
    driven, fresh = restarted(), armed()
    driven.state.odometry.bend_x_m = driven.state.odometry.bend_y_m = 0.1
    for name in COVARIANCES:
        setattr(driven.state.odometry, name, 0.3)
    assert place.set_pose(driven.state, GIVEN) == reasons.OK
    odometry = driven.state.odometry
    assert driven.machine.placed
    assert odometry.pose == GIVEN
    assert spread(odometry) == spread(fresh.state.odometry)
    assert spread(odometry)[0] > 0.0
    assert (odometry.bend_x_m, odometry.bend_y_m) == (0.0, 0.0)


def test_robot_drives_from_its_given_pose() -> None:
    driven = rearmed()
    assert place.set_pose(driven.state, Pose(2.9, 0.0, pi)) == reasons.OK
    assert driven.goto(AHEAD._replace(x_m=2.0)) == reasons.OK
    driven.forward(10.0)
    assert driven.machine.goal_state == states.REACHED
    assert driven.state.odometry.pose.x_m == pytest.approx(2.0, abs=0.05)


def test_trail_and_tracks_of_pedestrians_begin_anew() -> None:
    driven = driving()
    driven.forward(3.0)
    modes.abort(driven.machine, 0)
    tracks = driven.state.ring.pedestrians
    driven.state.ring.approach_m_s = [0.5] * 8
    assert driven.state.trail.count > 1
    assert place.set_pose(driven.state, GIVEN) == reasons.OK
    assert driven.state.trail.count == 0
    assert driven.state.trail.spacing_m == Trail().spacing_m
    assert driven.state.ring.pedestrians is not tracks
    assert driven.state.ring.approach_m_s == [0.0] * 8
    driven.tick()
    assert driven.state.trail.count == 1
    assert driven.state.trail.xs_m[0] == pytest.approx(GIVEN.x_m, abs=0.05)


def test_heading_is_kept_if_none_is_given() -> None:
    driven = armed()
    assert place.set_pose(driven.state, GIVEN) == reasons.OK
    assert place.set_pose(driven.state, Pose(0.0, 0.0, nan)) == reasons.OK
    assert driven.state.odometry.pose == Pose(0.0, 0.0, GIVEN.heading_rad)


def test_unknown_heading_cannot_be_kept() -> None:
    driven = restarted()
    assert place.set_pose(driven.state, Pose(1.0, 1.0, nan)) == reasons.PLACE_UNKNOWN
    assert not driven.machine.placed


def test_heading_is_wrapped() -> None:
    driven = armed()
    assert place.set_pose(driven.state, Pose(0.0, 0.0, 1.5 * pi)) == reasons.OK
    assert driven.state.odometry.pose.heading_rad == pytest.approx(-0.5 * pi)


@each("far", [100.0, -100.0])
def test_pose_may_be_as_far_as_a_goal(far: float) -> None:
    driven = armed()
    assert place.set_pose(driven.state, Pose(far, far, 1e3)) == reasons.OK
    assert place.set_pose(driven.state, Pose(far, far, -1e3)) == reasons.OK


@each(
    "pose",
    [
        *(Pose(x, 0.0, 0.0) for x in (nan, inf, -inf, 100.001, -100.001)),
        *(Pose(0.0, y, 0.0) for y in (nan, inf, -inf, 100.001, -100.001)),
        *(Pose(0.0, 0.0, h) for h in (inf, -inf, 1001.0, -1001.0)),
    ],
)
def test_pose_out_of_range_is_refused(pose: Pose) -> None:
    driven = armed()
    before = driven.state.odometry.pose
    assert place.set_pose(driven.state, pose) == reasons.PARAMETER_OUT_OF_RANGE
    assert driven.state.odometry.pose == before


def test_pose_is_refused_while_a_goal_is_active_or_held() -> None:
    driven = driving()
    assert place.set_pose(driven.state, GIVEN) == reasons.DRIVING
    modes.hold(driven.machine)
    assert place.set_pose(driven.state, GIVEN) == reasons.DRIVING
    modes.abort(driven.machine, 0)
    assert place.set_pose(driven.state, GIVEN) == reasons.OK


def test_pose_is_refused_before_the_first_senses() -> None:
    driven = Driven(DEFAULTS)
    assert place.set_pose(driven.state, GIVEN) == reasons.NO_SENSES
    driven.tick()
    assert place.set_pose(driven.state, GIVEN) == reasons.OK


def test_totals_are_compared_wheel_by_wheel() -> None:
    odometry = Odometry()
    odometry.left, odometry.right = 3, 4
    assert place.is_at_start(odometry, Wheels(3, 4, 0, 0))
    assert not place.is_at_start(odometry, Wheels(4, 3, 0, 0))
    assert not place.is_at_start(odometry, Wheels(3, 3, 0, 0))
