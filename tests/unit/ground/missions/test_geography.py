"""Latitude and longitude around a home: x east, y north, on the WGS 84 ellipsoid."""

from math import cos, radians, sin, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.missions.mission import FARTHEST_M, Home
from ground.missions.qgroundcontrol import heading_of, to_global, to_local, yaw_of
from tests.support.each import each
from tests.support.ground.missions.made_up import homes, metres

ZURICH = Home(latitude_deg=47.4, longitude_deg=8.5)
kilometre = st.floats(-1000.0, 1000.0)


def earth_centred(latitude_deg: float, longitude_deg: float) -> tuple[float, float, float]:
    """Return the point of the WGS 84 ellipsoid, in metres from its centre."""
    latitude, longitude = radians(latitude_deg), radians(longitude_deg)
    squared = 0.00669437999014
    radius_m = 6_378_137.0 / sqrt(1 - squared * sin(latitude) ** 2)
    across_m = radius_m * cos(latitude)
    z_m = radius_m * (1 - squared) * sin(latitude)
    return across_m * cos(longitude), across_m * sin(longitude), z_m


def in_plane(home: Home, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Return east and north in the tangent plane, by a rotation of earth-centred metres."""
    latitude, longitude = radians(home.latitude_deg), radians(home.longitude_deg)
    here = earth_centred(latitude_deg, longitude_deg)
    there = earth_centred(home.latitude_deg, home.longitude_deg)
    x_m, y_m, z_m = (one - other for one, other in zip(here, there, strict=True))
    outward_m = x_m * cos(longitude) + y_m * sin(longitude)
    east_m = y_m * cos(longitude) - x_m * sin(longitude)
    return east_m, z_m * cos(latitude) - outward_m * sin(latitude)


def test_north_is_y_and_east_is_x() -> None:
    assert to_local(ZURICH, 47.401, 8.5) == pytest.approx((0.0, 111.1787), abs=1e-3)
    assert to_local(ZURICH, 47.4, 8.501) == pytest.approx((75.4865, 0.0), abs=1e-3)


def test_the_date_line_is_no_border() -> None:
    home = Home(latitude_deg=0.0, longitude_deg=179.9999)
    x_m, _ = to_local(home, 0.0, -179.9999)
    assert x_m == pytest.approx(22.26, abs=0.01)


@given(homes, kilometre, kilometre)
def test_one_kilometre_is_exact_on_the_ellipsoid(home: Home, x_m: float, y_m: float) -> None:
    assert in_plane(home, *to_global(home, x_m, y_m)) == pytest.approx((x_m, y_m), abs=1e-5)


@given(homes, kilometre, kilometre)
def test_whole_1e7_degrees_cost_less_than_a_centimetre(home: Home, x_m: float, y_m: float) -> None:
    rounded = [round(value * 1e7) / 1e7 for value in to_global(home, x_m, y_m)]
    assert to_local(home, rounded[0], rounded[1]) == pytest.approx((x_m, y_m), abs=0.01)


@given(homes, st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
def test_far_place_never_looks_near(home: Home, latitude: float, longitude: float) -> None:
    """The plane shows both sides of the globe: the far one is recognised."""
    east_m, north_m, up_m = (
        one - other
        for one, other in zip(
            earth_centred(latitude, longitude),
            earth_centred(home.latitude_deg, home.longitude_deg),
            strict=True,
        )
    )
    if sqrt(east_m**2 + north_m**2 + up_m**2) > 3 * FARTHEST_M:
        assert max(map(abs, to_local(home, latitude, longitude))) > FARTHEST_M


@each(("yaw_deg", "heading_deg"), [(360.0, 90.0), (90.0, 0.0), (180.0, -90.0), (270.0, 180.0)])
def test_a_compass_turns_the_other_way_from_north(yaw_deg: float, heading_deg: float) -> None:
    assert heading_of(yaw_deg) == heading_deg
    assert yaw_of(heading_deg) == yaw_deg


@given(homes, metres, metres)
def test_conversion_round_trip_is_exact_to_a_tenth_mm(home: Home, x_m: float, y_m: float) -> None:
    assert to_local(home, *to_global(home, x_m, y_m)) == (x_m, y_m)


@given(st.floats(-360.0, 360.0))
def test_no_heading_is_written_as_the_yaw_that_means_none(heading_deg: float) -> None:
    assert 0.0 < yaw_of(heading_deg) <= 360.0
