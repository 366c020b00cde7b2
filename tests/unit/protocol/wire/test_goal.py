"""Conversion of a goal to integers of the wire, and of a start to text and back."""

from math import inf, nan, pi, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.outcome import rounded_heading_rad, start_arguments, wire_goal
from robot.core.values import goal_of
from tests.support.each import each

metres = st.floats(-100.0, 100.0)
TOLERANCES = (0.05, 0.05235987755982989)


def test_a_goal_is_rounded_to_millimetres_and_microradians() -> None:
    assert wire_goal(5.4, -0.0204, pi / 2, *TOLERANCES) == (5400, -20, 1_570_796, 0, 50, 52360)


def test_any_heading_is_a_flag_and_not_an_angle() -> None:
    goal = wire_goal(1.0, 0.0, None, *TOLERANCES)
    assert (goal.heading_free, goal.heading_urad) == (1, 0)
    assert goal_of(*goal).heading_rad is None


@each("place", range(5))
@each("bad", [nan, inf, -inf])
def test_non_finite_goal_is_rejected(bad: float, place: int) -> None:
    values = [1.0, 2.0, 0.0, *TOLERANCES]
    values[place] = bad
    with pytest.raises(ValueError, match="finite"):
        wire_goal(*values)


@given(metres, metres, st.floats(-2 * pi, 2 * pi))
def test_the_core_gets_the_goal_within_half_a_millimetre(
    x_m: float, y_m: float, heading_rad: float
) -> None:
    goal = goal_of(*wire_goal(x_m, y_m, heading_rad, *TOLERANCES))
    assert goal.heading_rad is not None
    assert abs(goal.x_m - x_m) <= 0.000_501
    assert abs(goal.y_m - y_m) <= 0.000_501
    assert abs(goal.heading_rad - heading_rad) <= 0.51e-6


@given(metres, metres, st.integers(-360_000, 360_000))
def test_start_given_as_text_arrives_bit_identical(x: float, y: float, mdeg: int) -> None:
    heading_rad = radians(mdeg / 1000)
    words = start_arguments(x, y, heading_rad)
    assert (float(words[0]), float(words[1])) == (x, y)
    assert radians(float(words[2])) == rounded_heading_rad(heading_rad) == heading_rad
