"""Messages about the sonars: left to right, with no echo, failed and touching told apart."""

import pytest

from gateways.mavlink import telemetry_messages
from gateways.mavlink.mavlink_dialect import mavlink
from tests.support.each import each
from tests.support.gateway.fake_port import Bench
from tests.support.gateway.telemetry import everything, scan, wheels


def bench_with(**telemetry: object) -> Bench:
    bench = Bench()
    bench.port.telemetry = everything() | telemetry
    bench.after(0.02)
    return bench


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
