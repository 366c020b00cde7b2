"""Health bits, battery, estimator and clock."""

from math import nan
from typing import Any

import pytest

from gateways.mavlink import telemetry_messages
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.services import face_of
from ground.client.operations.fences import FenceShown, ShowFence
from ground.missions.mission import Circle
from protocol.wire.enums import Vehicle
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.gateway.fake_port import CLIENT, Bench
from tests.support.gateway.telemetry import everything, odometry, scan, status

NOW_NS = 20_000_000


def built(build: object, **telemetry: Any) -> MavMessage:
    bench = Bench()
    bench.port.telemetry = everything() | telemetry
    bench.after(0.02)
    bench.vehicle.unix_offset_ns = 1_000_000_000_000
    (message,) = build(bench.vehicle, NOW_NS)  # type: ignore[operator]
    return message


def missing(**telemetry: Any) -> int:
    """Return the bits that are enabled and not healthy."""
    message = built(telemetry_messages.sys_status, **telemetry)
    assert message.onboard_control_sensors_present == message.onboard_control_sensors_enabled
    enabled: int = message.onboard_control_sensors_enabled
    healthy: int = message.onboard_control_sensors_health
    return enabled & ~healthy


def test_healthy_robot_has_every_bit() -> None:
    assert missing() == 0
    message = built(telemetry_messages.sys_status)
    for bit in ("PREARM_CHECK", "GEOFENCE", "SENSOR_PROXIMITY", "SENSOR_3D_GYRO", "SENSOR_GPS"):
        assert message.onboard_control_sensors_present & getattr(mavlink, f"MAV_SYS_STATUS_{bit}")
    assert message.load == 50


def test_battery_is_unknown_not_empty() -> None:
    message = built(telemetry_messages.sys_status)
    assert (message.voltage_battery, message.battery_remaining) == (65_535, -1)
    battery = built(telemetry_messages.battery_status)
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
    message = built(telemetry_messages.ekf_status)
    assert message.flags & mavlink.EKF_POS_HORIZ_ABS
    assert message.flags & mavlink.EKF_PRED_POS_HORIZ_ABS
    assert not message.flags & mavlink.EKF_CONST_POS_MODE
    assert message.pos_horiz_variance == pytest.approx(0.04)
    assert message.compass_variance == 0.003


def test_estimator_without_a_place_is_only_relative() -> None:
    message = built(telemetry_messages.ekf_status, odometry=odometry(cov_xx_m2=nan))
    assert not message.flags & mavlink.EKF_POS_HORIZ_ABS
    assert message.flags & mavlink.EKF_POS_HORIZ_REL
    assert built(telemetry_messages.ekf_status, odometry=None).flags == mavlink.EKF_UNINITIALIZED


def test_system_time_is_the_time_of_day() -> None:
    message = built(telemetry_messages.system_time)
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
