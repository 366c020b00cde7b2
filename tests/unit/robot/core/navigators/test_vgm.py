from math import atan2, cos, degrees, hypot, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core import states
from robot.core.navigators import paper
from robot.core.navigators.paper import PaperMemory
from robot.core.parameters import DEFAULTS
from robot.core.perception.sonar_ring import Ring
from robot.core.values import BEARINGS, Decision, Goal, Pose, wrap
from tests.support.robot.core.rings import ring

places = st.floats(-20.0, 20.0)
poses = st.builds(Pose, places, places, st.floats(-pi, pi))


def goal(x_m: float, y_m: float) -> Goal:
    return Goal(x_m, y_m, None, 0.05, 0.05)


def decide(pose: Pose, seen: Ring, x_m: float, y_m: float) -> Decision:
    return paper.step_vgm(PaperMemory(), pose, seen, goal(x_m, y_m), DEFAULTS)


def bearing_of_virtual_goal(pose: Pose, decision: Decision) -> float:
    dx_m, dy_m = decision.virtual_x_m - pose.x_m, decision.virtual_y_m - pose.y_m
    return wrap(atan2(dy_m, dx_m) - pose.heading_rad)


@given(poses, st.integers(0, 7), st.integers(20, 299), st.floats(-pi, pi), st.floats(0.1, 20))
def test_virtual_goal_keeps_distance_and_is_tangent(
    pose: Pose, sonar: int, range_mm: int, goal_at_rad: float, distance_m: float
) -> None:
    x_m, y_m = pose.x_m + distance_m * cos(goal_at_rad), pose.y_m + distance_m * sin(goal_at_rad)
    decision = decide(pose, ring({sonar: range_mm}), x_m, y_m)
    virtual_m = hypot(decision.virtual_x_m - pose.x_m, decision.virtual_y_m - pose.y_m)
    assert virtual_m == pytest.approx(distance_m, abs=1e-9)
    tangent_rad = bearing_of_virtual_goal(pose, decision)
    away_rad = wrap(tangent_rad - BEARINGS[sonar])
    assert abs(away_rad) == pytest.approx(pi / 2, abs=1e-6)
    obstacle_left = BEARINGS[sonar] > 0
    assert (away_rad < 0) == obstacle_left  # it stays on the side it is on
    assert decision.branch == (states.PASS_RIGHT if obstacle_left else states.PASS_LEFT)


def test_an_obstacle_ahead_on_the_left_is_passed_on_the_right() -> None:
    decision = decide(Pose(0.0, 0.0, 0.0), ring({4: 250}), 3.0, 0.0)
    assert degrees(decision.rotation_rad) == pytest.approx(11.25 - 90)
    assert decision.virtual_y_m < 0.0
    assert decision.nearest_bearing_rad == BEARINGS[4]


def test_outside_the_avoidance_zone_nothing_is_rotated() -> None:
    for echoes in ({}, {3: 301}, {3: 300}):
        decision = decide(Pose(1.0, 1.0, 0.5), ring(echoes), 3.0, -1.0)
        assert decision.branch == states.TO_GOAL
        assert decision.rotation_rad == 0.0
        assert (decision.virtual_x_m, decision.virtual_y_m) == (3.0, -1.0)


def test_only_the_nearest_echo_counts() -> None:
    one = decide(Pose(0.0, 0.0, 0.0), ring({6: 150}), 3.0, 0.0)
    many = decide(Pose(0.0, 0.0, 0.0), ring({6: 150, 1: 160, 3: 280, 7: 200}), 3.0, 0.0)
    assert many == one


@given(poses, st.integers(0, 7), places, places)
def test_rotation_about_the_robot_is_independent_of_the_map(
    pose: Pose, sonar: int, shift_x_m: float, shift_y_m: float
) -> None:
    seen = ring({sonar: 200})
    here = decide(pose, seen, pose.x_m + 2.0, pose.y_m + 1.0)
    moved = Pose(pose.x_m + shift_x_m, pose.y_m + shift_y_m, pose.heading_rad)
    there = decide(moved, seen, moved.x_m + 2.0, moved.y_m + 1.0)
    assert wrap(there.rotation_rad - here.rotation_rad) == pytest.approx(0.0, abs=1e-9)
    assert there.virtual_x_m - shift_x_m == pytest.approx(here.virtual_x_m, abs=1e-9)


def test_it_has_no_memory() -> None:
    memory, pose = PaperMemory(), Pose(0.0, 0.0, 0.0)
    first = paper.step_vgm(memory, pose, ring({}), goal(3.0, 0.0), DEFAULTS)
    for _ in range(50):
        paper.step_vgm(memory, pose, ring({2: 100}), goal(3.0, 0.0), DEFAULTS)
    assert paper.step_vgm(memory, pose, ring({}), goal(3.0, 0.0), DEFAULTS) == first
