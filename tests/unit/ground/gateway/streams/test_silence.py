"""The bus cut for 5 s: what is stale is not sent as live, and clients learn why."""

import pytest

from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.services import face_of
from tests.support.gateway.fake_port import CLIENT, OTHER, Bench
from tests.support.gateway.messages import command, words
from tests.support.gateway.telemetry import everything

LIVE = {
    "GLOBAL_POSITION_INT",
    "LOCAL_POSITION_NED",
    "ATTITUDE",
    "VFR_HUD",
    "LOCAL_POSITION_NED_COV",
    "ODOMETRY",
    "OBSTACLE_DISTANCE",
    "DISTANCE_SENSOR",
    "RANGEFINDER",
}


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.face.join(CLIENT.client)
    bench.port.telemetry |= everything()
    return bench


def test_stale_values_are_not_sent_as_live(bench: Bench) -> None:
    assert {one.get_type() for one in bench.after(2.0)} >= LIVE
    bench.port.telemetry.clear()
    bench.after(0.1)
    found = bench.after(5.0)
    kinds = {one.get_type() for one in found}
    assert not kinds & LIVE
    assert "HEARTBEAT" in kinds
    fixes = {one.fix_type for one in found if one.get_type() == "GPS_RAW_INT"}
    assert fixes == {mavlink.GPS_FIX_TYPE_NO_FIX}
    healths = {
        one.onboard_control_sensors_health for one in found if one.get_type() == "SYS_STATUS"
    }
    assert healths == {0}
    bench.port.telemetry |= everything()
    assert {one.get_type() for one in bench.after(2.0)} >= LIVE


def test_each_client_is_told_once_why_and_when_it_is_over(bench: Bench) -> None:
    bench.after(2.0)
    bench.port.telemetry.clear()
    bench.after(0.9)
    assert words(bench.after(0.2)).startswith("no telemetry arrives from the robot")
    bench.face.join(OTHER.client)
    bench.now_ns += 20_000_000
    bench.face.due(bench.now_ns)
    assert words(bench.sent(CLIENT.client)) == ""
    bench.after(3.9)
    bench.port.telemetry |= everything()
    bench.now_ns += 20_000_000
    bench.face.due(bench.now_ns)
    sends = [one for one in bench.vehicle.outbox.take() if one.message.get_type() == "STATUSTEXT"]
    assert [one.client for one in sends] == [CLIENT.client, OTHER.client]
    assert words([sends[0].message]) == "telemetry arrives again, after 5 s"


def test_single_messages_of_a_silent_robot_are_refused(bench: Bench) -> None:
    bench.after(1.0)
    bench.port.telemetry.clear()
    bench.after(1.5)
    found = bench.send(command(512, 33))
    assert [one.result for one in found if one.get_type() == "COMMAND_ACK"] == [1]
    assert "GLOBAL_POSITION_INT" not in {one.get_type() for one in found}
