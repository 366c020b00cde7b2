"""Conversions between the robot's frame and MAVLink's, in both directions."""

from math import atan2, cos, nan, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateways.mavlink import coordinates
from ground.missions.mission import Home
from tests.support.each import each
from tests.support.gateway.fake_port import ORIGIN
from tests.support.gateway.telemetry import odometry
from tests.support.ground.missions.made_up import homes

angles = st.floats(-50.0, 50.0)
kilometre = st.floats(-1000.0, 1000.0)
origins = st.builds(
    coordinates.GlobalPlace,
    st.integers(-850_000_000, 850_000_000) | st.sampled_from((-850_000_000, 850_000_000, 0)),
    st.integers(-1_800_000_000, 1_800_000_000)
    | st.sampled_from((-1_800_000_000, 1_799_999_999, 1_800_000_000)),
).filter(any)


@each(("heading_rad", "yaw_rad"), [(0.0, pi / 2), (pi / 2, 0.0), (pi, -pi / 2), (-pi / 2, pi)])
def test_yaw_counts_clockwise_from_north(heading_rad: float, yaw_rad: float) -> None:
    assert coordinates.yaw_of(heading_rad) == pytest.approx(yaw_rad)


@given(angles)
def test_yaw_is_within_half_a_turn(angle: float) -> None:
    assert -pi < coordinates.yaw_of(angle) <= pi


@given(angles)
def test_heading_survives_the_way_to_yaw_and_back(angle: float) -> None:
    back = coordinates.heading_of(coordinates.yaw_of(angle))
    assert atan2(sin(back - angle), cos(back - angle)) == pytest.approx(0.0, abs=1e-9)


@given(angles)
def test_yaw_survives_the_way_to_heading_and_back(angle: float) -> None:
    back = coordinates.yaw_of(coordinates.heading_of(angle))
    assert atan2(sin(back - angle), cos(back - angle)) == pytest.approx(0.0, abs=1e-9)


@given(angles, st.floats(-1.0, 1.0))
def test_velocity_points_along_the_yaw(heading_rad: float, speed_m_s: float) -> None:
    pose = coordinates.pose_of(odometry(heading_rad=heading_rad, speed_m_s=speed_m_s))
    assert pose.north_m_s == pytest.approx(speed_m_s * cos(pose.yaw_rad), abs=1e-9)
    assert pose.east_m_s == pytest.approx(speed_m_s * sin(pose.yaw_rad), abs=1e-9)


@given(angles)
def test_compass_angle_is_in_range(heading_rad: float) -> None:
    pose = coordinates.pose_of(odometry(heading_rad=heading_rad))
    assert 0 <= pose.yaw_cdeg < 36_000


@given(homes, kilometre, kilometre)
def test_place_survives_the_globe_to_a_centimetre(home: Home, x_m: float, y_m: float) -> None:
    place = coordinates.place_at(home, x_m, y_m)
    assert place is not None
    assert coordinates.local_at(home, place) == pytest.approx((x_m, y_m), abs=0.01)


@given(origins, kilometre, kilometre)
def test_kilometre_is_exact_up_to_85_degrees_and_over_the_date_line(
    origin: coordinates.GlobalPlace, x_m: float, y_m: float
) -> None:
    home = coordinates.home_at(origin)
    assert home is not None
    place = coordinates.place_at(home, x_m, y_m)
    assert place is not None
    assert abs(place.latitude_e7) <= 900_000_000
    assert abs(place.longitude_e7) <= 1_800_000_000
    assert coordinates.local_at(home, place) == pytest.approx((x_m, y_m), abs=0.01)


@given(origins, kilometre, kilometre)
def test_place_of_a_client_keeps_its_digits(
    origin: coordinates.GlobalPlace, x_m: float, y_m: float
) -> None:
    home = coordinates.home_at(origin)
    assert home is not None
    place = coordinates.place_at(home, x_m, y_m)
    assert place is not None
    back = coordinates.place_at(home, *coordinates.local_at(home, place))
    assert back is not None
    assert abs(back.latitude_e7 - place.latitude_e7) <= 1
    turn = abs(back.longitude_e7 - place.longitude_e7) % 3_600_000_000
    assert min(turn, 3_600_000_000 - turn) <= 1


@each("x_m", [nan, 1e9, -1e300])
def test_there_is_no_place_beyond_the_missions(x_m: float) -> None:
    assert coordinates.place_at(ORIGIN, x_m, 0.0) is None


@each("place", [(0, 0), (851_000_000, 0), (-900_000_000, 5), (5, 1_800_000_001), (-(2**31), 2**31)])
def test_origin_lies_on_the_globe(place: tuple[int, int]) -> None:
    assert coordinates.home_at(coordinates.GlobalPlace(*place)) is None


def test_origin_keeps_its_place() -> None:
    found = coordinates.home_at(coordinates.GlobalPlace(473_769_000, 85_417_000))
    assert found == Home(latitude_deg=47.3769, longitude_deg=8.5417)


def test_deviation_is_that_of_the_worst_direction() -> None:
    skewed = odometry(cov_xx_m2=0.05, cov_xy_m2=0.04, cov_yy_m2=0.05)
    assert coordinates.deviation_m(skewed) == pytest.approx(0.3)
