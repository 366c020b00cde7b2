from dataclasses import fields
from math import inf, nan

import pytest

from plant.model.configuration import Body
from tests.support.each import each


def test_track_too_narrow_for_the_speed_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"^track_m: 1e-06 is too narrow for max_speed_m_s"):
        Body(track_m=1e-6)


def test_default_robot_matches_the_figures() -> None:
    body = Body()
    assert (body.radius_m, body.track_m, body.max_speed_m_s) == (0.12, 0.20, 0.30)
    assert (body.max_acceleration_m_s2, 1.0 / body.ticks_per_m) == (1.5, 0.0002)


@each("name", [field.name for field in fields(Body)])
@each("value", [nan, inf, -inf, -1e12])
def test_impossible_dimension_is_rejected_by_name(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"^{name}: "):
        Body(**{name: value})  # type: ignore[arg-type]


def test_only_motor_lag_and_minimum_range_may_be_zero() -> None:
    assert Body(motor_lag_s=0.0, sonar_min_m=0.0).motor_lag_s == 0.0
    with pytest.raises(ValueError, match=r"^track_m: 0.0 must be above zero"):
        Body(track_m=0.0)


def test_wheels_outside_the_robot_are_rejected() -> None:
    with pytest.raises(ValueError, match=r"^track_m: .* wider than the robot"):
        Body(track_m=0.25)


def test_sonar_without_a_range_span_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"^sonar_max_m: "):
        Body(sonar_max_m=0.02)


@each("start", [2**31, -(2**31) - 1])
def test_encoder_counter_starts_within_32_bits(start: int) -> None:
    with pytest.raises(ValueError, match=r"^left_start_ticks: .* does not fit 32 bits"):
        Body(left_start_ticks=start)
