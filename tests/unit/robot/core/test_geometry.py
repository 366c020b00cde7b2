from math import cos, degrees, inf, isnan, nan, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core.values import BEARINGS, COSINES, SINES, wrap
from tests.support.each import each


@given(st.floats(-1e6, 1e6))
def test_wrapped_angle_has_the_same_direction(angle_rad: float) -> None:
    wrapped_rad = wrap(angle_rad)
    assert -pi < wrapped_rad <= pi
    assert cos(wrapped_rad) == pytest.approx(cos(angle_rad), abs=1e-9)
    assert sin(wrapped_rad) == pytest.approx(sin(angle_rad), abs=1e-9)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_whatever_the_size_the_result_is_within_half_a_turn(angle_rad: float) -> None:
    assert -pi < wrap(angle_rad) <= pi


def test_half_a_turn_is_counted_to_the_left() -> None:
    assert wrap(pi) == pi
    assert wrap(-pi) == pi
    assert wrap(3 * pi) == pytest.approx(pi)


@each("nowhere", [nan, inf, -inf])
def test_infinite_angle_becomes_nan(nowhere: float) -> None:
    assert isnan(wrap(nowhere))


def test_eight_cones_tile_the_half_circle_from_right_to_left() -> None:
    bearings = [degrees(bearing) for bearing in BEARINGS]
    assert bearings == pytest.approx([-78.75, -56.25, -33.75, -11.25, 11.25, 33.75, 56.25, 78.75])
    assert pytest.approx([1.0] * 8) == [c * c + s * s for c, s in zip(COSINES, SINES, strict=True)]
