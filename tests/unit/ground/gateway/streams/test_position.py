"""Messages about the position and the motion: north-east-down, and unknown values are marked."""

from math import cos, isnan, nan, radians, sin

import pytest

from gateways.mavlink import telemetry_messages
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from ground.missions.qgroundcontrol import to_global
from tests.support.each import each
from tests.support.gateway.fake_port import ORIGIN, Bench
from tests.support.gateway.telemetry import everything, odometry

YAW_RAD = radians(-45.0)


def bench_with(**telemetry: object) -> Bench:
    bench = Bench()
    bench.port.telemetry = everything() | telemetry
    bench.after(0.02)
    return bench


def built(build: object, bench: Bench | None = None) -> MavMessage:
    bench = bench or bench_with()
    (message,) = build(bench.vehicle, bench.now_ns)  # type: ignore[operator]
    return message


def test_global_position_is_that_of_the_pose() -> None:
    message = built(telemetry_messages.global_position)
    latitude_deg, longitude_deg = to_global(ORIGIN, 3.0, 4.0)
    assert (message.lat, message.lon) == (round(latitude_deg * 1e7), round(longitude_deg * 1e7))
    assert message.relative_alt == 0
    assert (message.vx, message.vy) == (14, -14)
    assert message.hdg == 31_500


def test_local_position_is_north_east_down() -> None:
    message = built(telemetry_messages.local_position)
    assert (message.x, message.y, message.z) == (4.0, 3.0, 0.0)
    assert (message.vx, message.vy) == pytest.approx((0.2 * sin(-YAW_RAD), 0.2 * -cos(YAW_RAD)))


def test_attitude_turns_clockwise() -> None:
    message = built(telemetry_messages.attitude)
    assert message.yaw == pytest.approx(YAW_RAD)
    assert message.yawspeed == -0.5
    assert message.time_boot_ms == 20


def test_hud_shows_speed_and_compass() -> None:
    message = built(telemetry_messages.hud)
    assert (message.groundspeed, message.airspeed) == (0.2, 0.2)
    assert message.heading == 315


@each(("limits", "throttle"), [({"v_max_m_s": 0.3}, 67), ({"v_max_m_s": 0.8}, 25), ({}, 0)])
def test_hud_shows_the_share_of_the_robot_s_own_speed(
    limits: dict[str, float], throttle: int
) -> None:
    bench = bench_with()
    bench.vehicle.parameters |= limits
    assert built(telemetry_messages.hud, bench).throttle == throttle


def test_covariance_is_given_north_first() -> None:
    message = built(telemetry_messages.local_position_cov)
    assert message.covariance[0] == 0.01
    assert message.covariance[9] == 0.04
    assert isnan(message.covariance[24])


def test_odometry_turns_velocity_and_covariance() -> None:
    message = built(telemetry_messages.odometry_message)
    assert (message.vx, message.vy, message.yawspeed) == (0.2, 0.0, -0.5)
    assert message.q[0] == pytest.approx(cos(YAW_RAD / 2))
    assert message.q[3] == pytest.approx(sin(YAW_RAD / 2))
    upper = message.pose_covariance
    assert (upper[0], upper[5], upper[6], upper[10], upper[20]) == (
        *(0.01, -0.002, 0.04, -0.001, 0.003),
    )


def test_gps_has_a_fix_and_its_accuracy() -> None:
    message = built(telemetry_messages.gps_raw)
    assert message.fix_type == mavlink.GPS_FIX_TYPE_3D_FIX
    assert 6 <= message.satellites_visible < 255
    assert (message.eph, message.h_acc) == (65_535, 200)


def test_home_is_at_the_origin_unless_it_is_moved() -> None:
    bench = bench_with()
    first = built(telemetry_messages.home_position, bench)
    assert (first.latitude, first.longitude) == (473_769_000, 85_417_000)
    bench.vehicle.home = (10.0, 20.0)
    moved = built(telemetry_messages.home_position, bench)
    assert (moved.x, moved.y) == (20.0, 10.0)
    assert moved.latitude > first.latitude


@each(
    "build",
    [
        telemetry_messages.global_position,
        telemetry_messages.local_position,
        telemetry_messages.attitude,
        telemetry_messages.hud,
        telemetry_messages.odometry_message,
        telemetry_messages.local_position_cov,
    ],
)
@each("pose", [None, odometry(x_m=nan), odometry(heading_rad=1e300)])
def test_stale_or_senseless_pose_is_not_sent(build: object, pose: object) -> None:
    bench = bench_with(odometry=pose)
    assert build(bench.vehicle, bench.now_ns) == ()  # type: ignore[operator]


def test_robot_that_does_not_know_its_place_has_no_global_one() -> None:
    bench = bench_with(odometry=odometry(cov_xx_m2=nan))
    assert telemetry_messages.global_position(bench.vehicle, bench.now_ns) == ()
    assert built(telemetry_messages.gps_raw, bench).fix_type == mavlink.GPS_FIX_TYPE_NO_FIX
    assert isnan(built(telemetry_messages.odometry_message, bench).pose_covariance[0])
    assert built(telemetry_messages.local_position, bench).x == 4.0


def test_pose_far_from_the_origin_has_no_global_one() -> None:
    bench = bench_with(odometry=odometry(x_m=900_000.0))
    assert telemetry_messages.global_position(bench.vehicle, bench.now_ns) == ()
    assert built(telemetry_messages.gps_raw, bench).fix_type == mavlink.GPS_FIX_TYPE_NO_FIX
