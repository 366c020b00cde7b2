"""HEARTBEAT: an ArduPilot Rover, once a second and at once on a change."""

from gateways.mavlink.ardupilot import state_of
from gateways.mavlink.liveness import HeartbeatStream
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.robot_port import Snapshot
from protocol.wire.enums import Mode, Vehicle
from tests.support.each import each
from tests.support.gateway.fake_port import CLIENT, Bench
from tests.support.gateway.telemetry import status


def after(bench: Bench, seconds: float, **changes: int) -> list[MavMessage]:
    bench.port.telemetry["status"] = status(**changes)
    return bench.after(seconds)


def test_heartbeat_is_that_of_a_rover_once_a_second() -> None:
    found = after(Bench(HeartbeatStream), 10.0)
    assert len(found) == 10
    for one in found:
        assert (one.type, one.autopilot) == (mavlink.MAV_TYPE_GROUND_ROVER, 3)
        assert one.base_mode == mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


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
