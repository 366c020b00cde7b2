"""Telemetry as MAVLink: frames of reference, heartbeat, position, sonars and health."""

from collections import Counter
from math import atan2, cos, inf, isnan, nan, pi, radians, sin
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from gateways.mavlink import coordinates, telemetry_messages
from gateways.mavlink.ardupilot import state_of
from gateways.mavlink.liveness import HeartbeatStream
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.robot_port import Snapshot
from gateways.mavlink.services import face_of
from ground.commands.fence import FenceShown, ShowFence
from ground.missions.mission import Circle, Home
from ground.missions.qgroundcontrol import to_global
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.gateway.fake_port import (
    CLIENT,
    ORIGIN,
    Bench,
    everything,
    odometry,
    scan,
    status,
    wheels,
)
from tests.support.ground.missions import homes

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


def after(bench: Bench, seconds: float, **changes: int) -> list[MavMessage]:
    bench.port.telemetry["status"] = status(**changes)
    return bench.after(seconds)


def test_heartbeat_is_that_of_a_rover_once_a_second() -> None:
    found = after(Bench(HeartbeatStream), 10.0)
    assert len(found) == 10
    for one in found:
        assert (one.type, one.autopilot) == (mavlink.MAV_TYPE_GROUND_ROVER, 3)
        assert one.base_mode == mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


@each(
    ("mode", "bits"),
    [(Mode.MANUAL, 64), (Mode.HOLD, 0), (Mode.AUTO, 8), (Mode.SMART_RTL, 8), (Mode.GUIDED, 8)],
)
def test_base_mode_tells_who_steers(mode: Mode, bits: int) -> None:
    """So mavros shows `manual_input` and `guided`."""
    (found,) = after(Bench(HeartbeatStream), 0.1, mode=mode)
    assert found.base_mode & (64 | 8) == bits


def test_change_of_mode_or_arming_is_sent_at_once() -> None:
    bench = Bench(HeartbeatStream)
    after(bench, 0.1)
    (mode,) = after(bench, 0.1, mode=Mode.GUIDED)
    (armed,) = after(bench, 0.1, mode=Mode.GUIDED, vehicle=Vehicle.ACTIVE)
    assert mode.custom_mode == 15
    assert not mode.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    assert armed.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED


def test_change_does_not_delay_the_next_heartbeat() -> None:
    bench = Bench(HeartbeatStream)
    assert len(after(bench, 0.5)) == 1
    assert len(after(bench, 0.1, mode=Mode.GUIDED)) == 1
    assert len(after(bench, 0.5, mode=Mode.GUIDED)) == 1
    assert len(after(bench, 10.0, mode=Mode.GUIDED)) == 10


def test_client_that_joins_gets_two_at_once() -> None:
    bench = Bench(HeartbeatStream)
    after(bench, 0.5)
    bench.face.join(CLIENT.client)
    assert len(bench.after(0.02)) == 1
    assert len(bench.after(0.3)) == 1
    bench.face.forget(CLIENT.client)
    bench.face.join(CLIENT.client)
    assert len(bench.after(0.02)) == 1
    bench.face.forget(CLIENT.client)
    assert len(bench.after(3.0)) == 3


@each(
    ("vehicle", "mode", "expected"),
    [
        (Vehicle.STANDBY, Mode.HOLD, mavlink.MAV_STATE_STANDBY),
        (Vehicle.ACTIVE, Mode.HOLD, mavlink.MAV_STATE_STANDBY),
        (Vehicle.STANDBY, Mode.MANUAL, mavlink.MAV_STATE_ACTIVE),
        (Vehicle.ACTIVE, Mode.AUTO, mavlink.MAV_STATE_ACTIVE),
        (Vehicle.FAILSAFE, Mode.GUIDED, mavlink.MAV_STATE_CRITICAL),
        (Vehicle.EMERGENCY_STOP, Mode.HOLD, mavlink.MAV_STATE_EMERGENCY),
        (Vehicle.BOOT, Mode.HOLD, mavlink.MAV_STATE_BOOT),
    ],
)
def test_state_follows_mode_and_failsafe(vehicle: Vehicle, mode: Mode, expected: int) -> None:
    (found,) = after(Bench(HeartbeatStream), 0.1, vehicle=vehicle, mode=mode)
    assert found.system_status == expected


@each("vehicle", [Vehicle.ACTIVE, Vehicle.STANDBY])
def test_silent_robot_is_not_shown_as_live(vehicle: Vehicle) -> None:
    """Nor as disarmed, if it may still drive."""
    bench = Bench(HeartbeatStream)
    after(bench, 0.1, vehicle=vehicle, mode=Mode.GUIDED)
    bench.port.telemetry = {}
    assert all(one.custom_mode == 15 for one in bench.after(0.98))
    found = bench.after(1.1)
    assert {one.system_status for one in found} == {mavlink.MAV_STATE_UNINIT}
    assert {one.custom_mode for one in found} == {mavlink.ROVER_MODE_INITIALIZING}
    armed = vehicle == Vehicle.ACTIVE
    assert {bool(one.base_mode & 128) for one in found} == {armed}
    (back,) = after(bench, 0.1, vehicle=Vehicle.STANDBY, mode=Mode.HOLD)
    assert (back.custom_mode, back.base_mode & 128) == (4, 0)


@each(
    ("robot", "shown", "expected"),
    [
        (Mode.HOLD, Mode.GUIDED, mavlink.MAV_STATE_ACTIVE),
        (Mode.GUIDED, Mode.HOLD, mavlink.MAV_STATE_STANDBY),
    ],
)
def test_state_is_that_of_the_mode_that_clients_see(
    robot: Mode, shown: Mode, expected: int
) -> None:
    found = state_of(Snapshot(0, status=status(mode=robot)), int(shown))
    assert (found.mode, found.system_status) == (shown, expected)


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


TO_GOAL = {"goal": GoalState.DRIVING, "goal_x_m": 3.0, "goal_y_m": 14.0, "goal_distance_m": 10.2}


def on_the_way(mode: Mode = Mode.GUIDED, **changes: float) -> Bench:
    fields: dict[str, Any] = {"mode": mode, "vehicle": Vehicle.ACTIVE} | TO_GOAL | changes
    return bench_with(status=status(**{"goal_heading_rad": nan, **fields}))


@each("mode", [Mode.AUTO, Mode.GUIDED, Mode.SMART_RTL])
def test_way_to_a_goal_is_shown(mode: Mode) -> None:
    output = built(telemetry_messages.nav_controller, on_the_way(mode))
    assert (output.target_bearing, output.nav_bearing, output.wp_dist) == (0, 0, 10)
    west = built(telemetry_messages.nav_controller, on_the_way(mode, goal_x_m=-7.0, goal_y_m=4.0))
    assert west.target_bearing == 270
    target = built(telemetry_messages.position_target, on_the_way(mode))
    latitude_deg, longitude_deg = to_global(ORIGIN, 3.0, 14.0)
    assert (target.lat_int, target.lon_int) == (
        round(latitude_deg * 1e7),
        round(longitude_deg * 1e7),
    )
    assert (target.type_mask, target.coordinate_frame) == (0xDF8, mavlink.MAV_FRAME_GLOBAL)
    turned = built(telemetry_messages.position_target, on_the_way(mode, goal_heading_rad=0.0))
    assert turned.type_mask == 0xDF8 & ~1024
    assert turned.yaw == pytest.approx(pi / 2)


@each(
    "changes",
    [
        {"mode": Mode.HOLD},
        {"mode": Mode.MANUAL},
        {"goal": GoalState.REACHED},
        {"goal": GoalState.NONE},
    ],
)
def test_no_way_is_shown_without_a_goal(changes: dict[str, Any]) -> None:
    bench = on_the_way(**changes)
    for build in (telemetry_messages.nav_controller, telemetry_messages.position_target):
        assert list(build(bench.vehicle, bench.now_ns)) == []


@each("value", [nan, inf, -inf, 1e308, -1e308])
def test_no_number_of_a_robot_ends_the_gateway(value: float) -> None:
    encoder, built_of = mavlink.MAVLink(None, 1, 1), Counter[str]()
    way = everything() | {"status": status(**TO_GOAL, mode=Mode.AUTO, goal_heading_rad=0.0)}
    for topic, message in way.items():
        for field in message.__struct_fields__:
            usual = getattr(message, field)
            if isinstance(usual, float):
                changed = replace(message, **{field: value})
            elif isinstance(usual, tuple) and isinstance(usual[0], float):
                changed = replace(message, **{field: (value, *usual[1:])})
            else:
                continue
            bench = bench_with(**way | {topic: changed})
            bench.face = face_of(bench.vehicle)
            for source in bench.vehicle.catalogue:
                for part in source.build(bench.now_ns):
                    part.pack(encoder)
                    built_of[topic] += 1
    assert built_of["odometry"] > 100
    assert built_of["status"] > 100


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


def test_obstacle_distances_run_from_left_to_right() -> None:
    bench = bench_with(scan=scan(valid=0b1111_1101, s7=1200, s3=500))
    (message,) = telemetry_messages.obstacle_distance(bench.vehicle, bench.now_ns)
    assert message.distances[:8] == [120, 301, 301, 301, 50, 301, 65_535, 301]
    assert set(message.distances[8:]) == {65_535}
    assert (message.angle_offset, message.increment_f, message.frame) == (-78.75, 22.5, 12)
    assert message.max_distance == 300


def test_distance_sensors_take_the_minimum_of_their_sonars() -> None:
    bench = bench_with(scan=scan(s7=1200, s6=900, s5=700, s0=0))
    messages = telemetry_messages.distance_sensors(bench.vehicle, bench.now_ns)
    shown = {message.orientation: message.current_distance for message in messages}
    assert shown == {6: 120, 7: 70, 0: 300, 1: 300, 2: 1}
    assert {message.max_distance for message in messages} == {300}
    assert messages[0].horizontal_fov == pytest.approx(0.785, abs=1e-3)
    assert [message.id for message in messages] == [0, 1, 2, 3, 4]


def test_sector_whose_sonars_have_failed_is_not_sent() -> None:
    bench = bench_with(scan=scan(valid=0b1001_0110, s1=800, s7=400))
    messages = telemetry_messages.distance_sensors(bench.vehicle, bench.now_ns)
    shown = {message.orientation: message.current_distance for message in messages}
    assert shown == {6: 40, 0: 300, 1: 80}


def test_rangefinder_shows_the_nearest_echo() -> None:
    bench = bench_with()
    assert telemetry_messages.rangefinder(bench.vehicle, bench.now_ns)[0].distance == 0.5


def test_rangefinder_without_an_echo_shows_the_farthest_range() -> None:
    bench = bench_with(scan=scan())
    assert telemetry_messages.rangefinder(bench.vehicle, bench.now_ns)[0].distance == 3.0


@each(
    "build",
    [
        telemetry_messages.obstacle_distance,
        telemetry_messages.distance_sensors,
        telemetry_messages.rangefinder,
    ],
)
def test_stale_scan_is_not_sent(build: object) -> None:
    bench = bench_with(scan=None)
    assert build(bench.vehicle, bench.now_ns) == ()  # type: ignore[operator]


def test_wheels_are_shown_in_metres() -> None:
    bench = bench_with(wheels=wheels(5000, -10_000))
    (message,) = telemetry_messages.wheel_distance(bench.vehicle, bench.now_ns)
    assert message.count == 2
    assert message.distance[:3] == pytest.approx([1.0, -2.0, 0.0])


def test_range_and_wheel_are_those_of_the_robot() -> None:
    bench = bench_with(scan=scan(), wheels=wheels(5000, -10_000))
    bench.vehicle.parameters |= {"sonar_max_m": 5.0, "m_per_tick": 0.001}
    (message,) = telemetry_messages.obstacle_distance(bench.vehicle, bench.now_ns)
    assert (message.max_distance, message.distances[0]) == (500, 501)
    assert message.sensor_type == mavlink.MAV_DISTANCE_SENSOR_ULTRASOUND
    (message,) = telemetry_messages.wheel_distance(bench.vehicle, bench.now_ns)
    assert message.distance[:2] == pytest.approx([5.0, -10.0])


@each(
    "build",
    [
        telemetry_messages.obstacle_distance,
        telemetry_messages.distance_sensors,
        telemetry_messages.rangefinder,
        telemetry_messages.wheel_distance,
    ],
)
def test_nothing_is_claimed_before_the_parameters_are_read(build: object) -> None:
    bench = bench_with()
    assert build(bench.vehicle, bench.now_ns) != ()  # type: ignore[operator]
    bench.vehicle.parameters.clear()
    assert build(bench.vehicle, bench.now_ns) == ()  # type: ignore[operator]


NOW_NS = 20_000_000


def built_in_time(build: object, **telemetry: Any) -> MavMessage:
    bench = Bench()
    bench.port.telemetry = everything() | telemetry
    bench.after(0.02)
    bench.vehicle.unix_offset_ns = 1_000_000_000_000
    (message,) = build(bench.vehicle, NOW_NS)  # type: ignore[operator]
    return message


def missing(**telemetry: Any) -> int:
    """Return the bits that are enabled and not healthy."""
    message = built_in_time(telemetry_messages.sys_status, **telemetry)
    assert message.onboard_control_sensors_present == message.onboard_control_sensors_enabled
    enabled: int = message.onboard_control_sensors_enabled
    healthy: int = message.onboard_control_sensors_health
    return enabled & ~healthy


def test_healthy_robot_has_every_bit() -> None:
    assert missing() == 0
    message = built_in_time(telemetry_messages.sys_status)
    for bit in ("PREARM_CHECK", "GEOFENCE", "SENSOR_PROXIMITY", "SENSOR_3D_GYRO", "SENSOR_GPS"):
        assert message.onboard_control_sensors_present & getattr(mavlink, f"MAV_SYS_STATUS_{bit}")
    assert message.load == 50


def test_battery_is_unknown_not_empty() -> None:
    message = built_in_time(telemetry_messages.sys_status)
    assert (message.voltage_battery, message.battery_remaining) == (65_535, -1)
    battery = built_in_time(telemetry_messages.battery_status)
    assert (battery.voltages[0], battery.battery_remaining) == (65_535, -1)
    assert battery.temperature == 0x7FFF


@each(
    ("telemetry", "bits"),
    [
        ({"scan": None}, telemetry_messages.SONAR_BITS | telemetry_messages.PREARM_BIT),
        ({"scan": scan(valid=0x7F)}, telemetry_messages.SONAR_BITS),
        ({"wheels": None}, telemetry_messages.PREARM_BIT),
        ({"odometry": None}, telemetry_messages.MOTION_BITS | telemetry_messages.PLACE_BITS),
        ({"odometry": odometry(cov_xx_m2=nan)}, telemetry_messages.PLACE_BITS),
        ({"status": status(vehicle=Vehicle.EMERGENCY_STOP)}, telemetry_messages.PREARM_BIT),
        (
            {"status": status(vehicle=Vehicle.FAILSAFE, vehicle_reason=Reason.FENCE_BREACHED)},
            telemetry_messages.FENCE_BITS,
        ),
        ({"status": status(vehicle_reason=Reason.WHEEL_STUCK)}, telemetry_messages.MOTOR_BITS),
        (dict.fromkeys(everything()), telemetry_messages.EVERY_BIT),
    ],
)
def test_each_fault_takes_its_bits(telemetry: dict[str, Any], bits: int) -> None:
    assert missing(**telemetry) == bits


def test_estimator_knows_its_place_and_how_well() -> None:
    message = built_in_time(telemetry_messages.ekf_status)
    assert message.flags & mavlink.EKF_POS_HORIZ_ABS
    assert message.flags & mavlink.EKF_PRED_POS_HORIZ_ABS
    assert not message.flags & mavlink.EKF_CONST_POS_MODE
    assert message.pos_horiz_variance == pytest.approx(0.04)
    assert message.compass_variance == 0.003


def test_estimator_without_a_place_is_only_relative() -> None:
    message = built_in_time(telemetry_messages.ekf_status, odometry=odometry(cov_xx_m2=nan))
    assert not message.flags & mavlink.EKF_POS_HORIZ_ABS
    assert message.flags & mavlink.EKF_POS_HORIZ_REL
    assert (
        built_in_time(telemetry_messages.ekf_status, odometry=None).flags
        == mavlink.EKF_UNINITIALIZED
    )


def test_system_time_is_the_time_of_day() -> None:
    message = built_in_time(telemetry_messages.system_time)
    assert (message.time_unix_usec, message.time_boot_ms) == (1_000_020_000, 20)


def test_fence_is_enabled_while_the_robot_has_one() -> None:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.face.join(CLIENT.client)
    bench.port.telemetry = everything()
    bits = []
    for fence in (Circle(x_m=0.0, y_m=0.0, radius_m=5.0), None):
        bench.after(11.0)
        while bench.port.waiting:
            is_asked = isinstance(bench.port.waiting[0][0], ShowFence)
            bench.port.answer(FenceShown(fence=fence) if is_asked else None)
        bench.after(0.1)
        (message,) = telemetry_messages.sys_status(bench.vehicle, bench.now_ns)
        assert message.onboard_control_sensors_present & telemetry_messages.FENCE_BITS
        bits.append(bool(message.onboard_control_sensors_enabled & telemetry_messages.FENCE_BITS))
    assert bits == [True, False]
