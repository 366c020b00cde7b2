"""Latitude and longitude around a home: x east, y north, exact to a tenth of a millimetre."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.missions.geography import heading_of, to_global, to_local, yaw_of
from ground.missions.mission import Home
from tests.support.ground.missions.made_up import homes, metres

ZURICH = Home(latitude_deg=47.4, longitude_deg=8.5)


def test_north_is_y_and_east_is_x() -> None:
    assert to_local(ZURICH, 47.401, 8.5) == pytest.approx((0.0, 111.3195), abs=1e-3)
    assert to_local(ZURICH, 47.4, 8.501) == pytest.approx((75.35, 0.0), abs=0.01)


def test_the_date_line_is_no_border() -> None:
    home = Home(latitude_deg=0.0, longitude_deg=179.9999)
    x_m, _ = to_local(home, 0.0, -179.9999)
    assert x_m == pytest.approx(22.26, abs=0.01)


@pytest.mark.parametrize(
    ("yaw_deg", "heading_deg"), [(360.0, 90.0), (90.0, 0.0), (180.0, -90.0), (270.0, 180.0)]
)
def test_a_compass_turns_the_other_way_from_north(yaw_deg: float, heading_deg: float) -> None:
    assert heading_of(yaw_deg) == heading_deg
    assert yaw_of(heading_deg) == yaw_deg


@given(homes, metres, metres)
def test_conversion_round_trip_is_exact_to_a_tenth_mm(home: Home, x_m: float, y_m: float) -> None:
    assert to_local(home, *to_global(home, x_m, y_m)) == (x_m, y_m)


@given(st.floats(-360.0, 360.0))
def test_no_heading_is_written_as_the_yaw_that_means_none(heading_deg: float) -> None:
    assert 0.0 < yaw_of(heading_deg) <= 360.0
