"""From a place in the world to the integers of a goal, and back."""

from math import cos, hypot, inf, nan, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.start_frame import Pose, goal_from, in_world

metres = st.floats(-50.0, 50.0)
angles = st.floats(-pi, pi)
TOLERANCES = (0.05, 0.05235987755982989)


def test_a_goal_straight_ahead_is_straight_ahead_whichever_way_the_robot_faces() -> None:
    for heading_rad in (0.0, 1.0, -2.0, pi):
        start = Pose(1.0, 2.0, heading_rad)
        x_m, y_m = 1.0 + 3.0 * cos(heading_rad), 2.0 + 3.0 * sin(heading_rad)
        goal = goal_from(start, x_m, y_m, heading_rad, *TOLERANCES)
        assert goal == (3000, 0, 0, 0, 50, 52360)


def test_a_goal_on_the_left_has_a_positive_y() -> None:
    goal = goal_from(Pose(0.0, 0.0, pi / 2), -1.0, 0.0, pi, *TOLERANCES)
    assert (goal.x_mm, goal.y_mm, goal.heading_urad) == (0, 1000, round(pi / 2 * 1e6))


def test_any_heading_is_a_flag_and_not_an_angle() -> None:
    goal = goal_from(Pose(0.0, 0.0, 1.0), 1.0, 0.0, None, *TOLERANCES)
    assert (goal.heading_free, goal.heading_urad) == (1, 0)


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_what_is_not_finite_is_refused(bad: float) -> None:
    start = Pose(0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="finite"):
        goal_from(start, bad, 0.0, 0.0, *TOLERANCES)
    with pytest.raises(ValueError, match="finite"):
        goal_from(start, 0.0, 0.0, bad, *TOLERANCES)
    with pytest.raises(ValueError, match="finite"):
        goal_from(Pose(0.0, bad, 0.0), 0.0, 0.0, None, *TOLERANCES)


@given(metres, metres, angles, metres, metres, angles)
def test_the_way_there_and_back_ends_within_half_a_millimetre(
    sx: float, sy: float, sh: float, x_m: float, y_m: float, heading_rad: float
) -> None:
    start = Pose(sx, sy, sh)
    goal = goal_from(start, x_m, y_m, heading_rad, *TOLERANCES)
    back = in_world(start, goal.x_mm / 1000, goal.y_mm / 1000, goal.heading_urad / 1e6)
    assert hypot(back.x_m - x_m, back.y_m - y_m) <= 0.000_71
    assert (
        hypot(cos(back.heading_rad) - cos(heading_rad), sin(back.heading_rad) - sin(heading_rad))
        <= 1e-6
    )
    assert abs(goal.heading_urad) <= round(pi * 1e6)
