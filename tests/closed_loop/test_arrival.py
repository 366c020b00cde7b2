"""Arrival at a goal: in the middle where there is room, within the tolerance otherwise."""

from math import cos, hypot, pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.core import brain, reasons, states
from robot.core.values import Goal, Outputs, wrap
from tests.support.closed_loop.toy import Toy, box, drive_to
from tests.support.each import each

TOLERANCE_RAD = 3 * pi / 180


def believed(state: brain.State, goal: Goal) -> float:
    pose = state.odometry.pose
    return hypot(pose.x_m - goal.x_m, pose.y_m - goal.y_m)


@settings(max_examples=settings().max_examples // 4, deadline=None)
@given(st.floats(0.3, 5.0), st.floats(-pi, pi), st.floats(-pi, pi))
def test_in_the_open_it_stops_in_the_middle_and_aligned(
    distance_m: float, at_rad: float, heading_rad: float
) -> None:
    goal = Goal(distance_m * cos(at_rad), distance_m * sin(at_rad), heading_rad, 0.05, 0.0524)
    state = drive_to(Toy(), goal)
    assert state.machine.goal_state == states.REACHED
    assert believed(state, goal) <= 0.03
    assert abs(wrap(state.odometry.pose.heading_rad - heading_rad)) <= 2 * pi / 180


def test_a_wide_tolerance_is_used() -> None:
    goal = Goal(2.0, 0.0, None, 0.5, TOLERANCE_RAD)
    state = drive_to(Toy(), goal)
    assert 0.15 < believed(state, goal) <= 0.2


@each(("tolerance_deg", "turns"), [(180.0, False), (20.0, True)])
def test_a_wide_heading_tolerance_is_used(tolerance_deg: float, turns: bool) -> None:
    goal = Goal(0.0, 0.0, pi / 2, 0.05, tolerance_deg * pi / 180)
    state = drive_to(Toy(), goal, limit_s=10.0)
    assert state.machine.goal_state == states.REACHED
    error_rad = abs(wrap(state.odometry.pose.heading_rad - pi / 2))
    assert error_rad <= goal.heading_tolerance_rad
    assert (state.odometry.pose.heading_rad != 0.0) is turns
    assert error_rad > 3 * pi / 180  # within the tolerance


def test_a_false_echo_at_the_goal_does_not_end_the_way_early() -> None:
    goal, ticks = Goal(1.0, 0.0, None, 0.05, TOLERANCE_RAD), [0]

    class FalseEchoes(Toy):
        def sonar_m(self, i: int) -> float:
            ticks[0] += 1
            return 0.2 if i == 7 and ticks[0] // 8 % 3 == 0 else super().sonar_m(i)

    state = drive_to(FalseEchoes(), goal, states.BUG)
    assert state.machine.goal_state == states.REACHED
    assert believed(state, goal) <= 0.03


def test_a_tolerance_finer_than_the_middle_is_kept() -> None:
    goal = Goal(1.0, 0.3, None, 0.01, TOLERANCE_RAD)
    state = drive_to(Toy(), goal)
    assert state.machine.goal_state == states.REACHED
    assert believed(state, goal) <= 0.01


def test_with_the_heading_free_it_does_not_turn_at_the_goal() -> None:
    seen: list[int] = []

    def each(state: brain.State, _outputs: Outputs) -> None:
        seen.append(state.machine.goal_state)

    state = drive_to(Toy(), Goal(1.0, 1.0, None, 0.05, TOLERANCE_RAD), each=each)
    assert state.machine.goal_state == states.REACHED
    assert states.ALIGNING not in seen


@each("gap_m", [0.1, 0.2])
@each("navigator", [states.BUG, states.VGM_MEMORY])
def test_in_front_of_a_wall_the_tolerance_will_do(navigator: int, gap_m: float) -> None:
    toy = Toy(walls=box(2.0 + 0.12 + gap_m, -1.0, 0.2, 2.0))
    goal = Goal(2.0, 0.0, 0.0, 0.05, TOLERANCE_RAD)
    state = drive_to(toy, goal, navigator)
    assert state.machine.goal_state == states.REACHED
    assert believed(state, goal) <= 0.05
    assert toy.clearance_m > 0.0


def test_goal_around_the_robot_is_reached_at_once() -> None:
    goal = Goal(-0.04, 0.0, None, 0.05, TOLERANCE_RAD)
    state = drive_to(Toy(), goal, limit_s=1.0)
    assert (state.machine.goal_state, state.machine.goal_reason) == (states.REACHED, reasons.OK)


def test_a_goal_at_the_robot_asks_for_a_turn_at_most() -> None:
    goal = Goal(0.0, 0.0, pi / 2, 0.05, TOLERANCE_RAD)
    toy = Toy()
    state = drive_to(toy, goal, limit_s=5.0)
    assert state.machine.goal_state == states.REACHED
    assert (toy.x_m, toy.y_m) == (0.0, 0.0)
    assert toy.heading_rad == pytest.approx(pi / 2, abs=2 * pi / 180)


def test_stopped_within_the_tolerance_it_counts_as_reached(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Stopping for a pedestrian must not end the goal as stuck."""
    goal = Goal(1.0, 0.0, None, 0.1, TOLERANCE_RAD)

    def no_farther(state: brain.State, _outputs: Outputs) -> None:
        if believed(state, goal) < 0.09:
            monkeypatch.setattr(
                "robot.core.perception.closing_speed.limit_m_s", lambda _ring, _most_m_s: 0.0
            )

    state = drive_to(Toy(), goal, each=no_farther)
    assert (state.machine.goal_state, state.machine.goal_reason) == (states.REACHED, reasons.OK)
    assert 0.04 < believed(state, goal) <= 0.1
