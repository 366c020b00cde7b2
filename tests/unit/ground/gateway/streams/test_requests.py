"""Single messages and intervals on request, and what is refused."""

from collections import deque
from math import inf, nan

from gateways.mavlink import ardupilot
from gateways.mavlink.mavlink_dialect import (
    AvailableModes,
    ComponentMetadata,
    CurrentMode,
    MavMessage,
    mavlink,
)
from gateways.mavlink.services import face_of
from gateways.mavlink.streams import STREAMS
from ground.client.operations.parameters import ShowParameters
from protocol.wire.enums import Mode
from tests.support.each import each
from tests.support.gateway.fake_port import CLIENT, Bench
from tests.support.gateway.parameter_bench import robot_table
from tests.support.gateway.telemetry import everything, status

REQUEST = mavlink.MAV_CMD_REQUEST_MESSAGE
SET_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
GET_INTERVAL = mavlink.MAV_CMD_GET_MESSAGE_INTERVAL
CAPABILITIES = mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES
READ = ShowParameters()
ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE
VERSION = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION


def whole_bench() -> Bench:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.port.telemetry = everything()
    bench.vehicle.commit = "0123456789abcdef"
    bench.face.join(CLIENT.client)
    bench.after(0.04)
    return bench


def ask(bench: Bench, command: int, *params: float) -> tuple[int, list[MavMessage]]:
    """Return the result and what is sent besides it and its words."""
    filled = [*params, *[0.0] * (7 - len(params))]
    found = bench.send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *filled))
    results = [one.result for one in found if one.get_type() == "COMMAND_ACK"]
    assert len(results) == 1
    rest = [one for one in found if one.get_type() not in ("COMMAND_ACK", "STATUSTEXT")]
    return results[0], rest


@each("ask_for", ["512", "520", "183"])
def test_autopilot_version_comes_by_each_request(ask_for: str) -> None:
    bench = whole_bench()
    if ask_for == "183":
        request = mavlink.MAVLink_autopilot_version_request_message(1, 1)
        messages = bench.send(request)
    elif ask_for == "520":
        messages = ask(bench, CAPABILITIES, 1.0)[1]
    else:
        messages = ask(bench, REQUEST, VERSION)[1]
    (message,) = messages
    assert message.capabilities == ardupilot.CAPABILITIES
    assert message.flight_sw_version >> 24 == 4
    assert message.flight_sw_version & 0xFF == mavlink.FIRMWARE_VERSION_TYPE_DEV
    assert bytes(message.flight_custom_version) == b"01234567"
    assert message.uid


def test_requested_message_is_sent_twice_on_a_lossy_line() -> None:
    bench = whole_bench()
    bench.vehicle.lossy = {CLIENT.client}
    assert len(ask(bench, REQUEST, VERSION)[1]) == 2


def test_version_of_another_robot_has_another_id() -> None:
    first, second = (ardupilot.autopilot_version(name, "") for name in ("r1", "r2"))
    assert first.uid != second.uid


def test_every_stream_can_be_requested_and_encoded() -> None:
    bench = whole_bench()
    encoder = mavlink.MAVLink(None, 1, 1)
    for stream in STREAMS:
        source = stream.source(bench.vehicle)
        result, messages = ask(bench, REQUEST, source.number)
        assert result == mavlink.MAV_RESULT_ACCEPTED, source.number
        for message in messages:
            frame = message.pack(encoder)
            assert len(frame) <= source.largest_bytes
            (found,) = mavlink.MAVLink(None, 1, 1).parse_buffer(frame)
            assert found.get_msgId() == source.number


def test_unknown_message_is_unsupported_at_once() -> None:
    assert ask(whole_bench(), REQUEST, 11_000)[0] == mavlink.MAV_RESULT_UNSUPPORTED


@each("number", [nan, inf, -1.0, 0.5, 1e30])
def test_request_for_no_message_is_denied(number: float) -> None:
    assert ask(whole_bench(), REQUEST, number) == (mavlink.MAV_RESULT_DENIED, [])
    assert ask(whole_bench(), GET_INTERVAL, number) == (mavlink.MAV_RESULT_DENIED, [])


def test_missing_values_are_rejected_for_now() -> None:
    bench = whole_bench()
    bench.port.telemetry = {}
    bench.after(0.02)
    assert ask(bench, REQUEST, ATTITUDE) == (mavlink.MAV_RESULT_TEMPORARILY_REJECTED, [])


def test_description_is_sent_when_the_robot_has_answered() -> None:
    bench = whole_bench()
    found = bench.send(mavlink.MAVLink_command_long_message(1, 1, REQUEST, 0, 397, *[0] * 6))
    assert not found
    bench.port.waiting = deque(one for one in bench.port.waiting if one[0] == READ)
    bench.port.answer(robot_table())
    description, acknowledgement = bench.sent(CLIENT.client)
    assert description.get_type() == ComponentMetadata.msgname
    assert acknowledgement.result == mavlink.MAV_RESULT_ACCEPTED


def test_description_is_refused_if_the_robot_does_not_answer() -> None:
    bench = whole_bench()
    bench.send(mavlink.MAVLink_command_long_message(1, 1, REQUEST, 0, 397, *[0] * 6))
    bench.port.waiting = deque(one for one in bench.port.waiting if one[0] == READ)
    bench.port.answer(error="no answer")
    results = [one.result for one in bench.sent() if one.get_type() == "COMMAND_ACK"]
    assert results == [mavlink.MAV_RESULT_TEMPORARILY_REJECTED]


def test_modes_are_listed_one_by_one_or_all() -> None:
    bench = whole_bench()
    messages = ask(bench, REQUEST, AvailableModes.id, 0.0)[1]
    assert [one.mode_index for one in messages] == list(range(1, len(messages) + 1))
    assert {one.number_modes for one in messages} == {len(messages)}
    assert {one.custom_mode for one in messages} == set(ardupilot.MODES_BY_NUMBER)
    (second,) = ask(bench, REQUEST, AvailableModes.id, 2.0)[1]
    assert (second.mode_index, second.mode_name) == (2, b"Hold")
    beyond = ask(bench, REQUEST, AvailableModes.id, 9.0)
    assert beyond == (mavlink.MAV_RESULT_DENIED, [])


def modes_in(messages: list[MavMessage]) -> list[int]:
    return [one.custom_mode for one in messages if one.get_msgId() == CurrentMode.id]


def test_mode_is_sent_to_clients_that_ask_for_modes() -> None:
    bench = whole_bench()
    assert modes_in(bench.after(4.0)) == []
    ask(bench, REQUEST, AvailableModes.id, 0.0)
    assert modes_in(bench.after(3.9)) == [4, 4]


def test_mode_is_sent_at_once_when_it_changes() -> None:
    bench = whole_bench()
    ask(bench, REQUEST, AvailableModes.id, 0.0)
    bench.after(1.0)
    bench.port.telemetry["status"] = status(mode=Mode.GUIDED)
    assert modes_in(bench.after(0.1)) == [15]


def test_interval_is_set_and_read() -> None:
    bench = whole_bench()
    assert ask(bench, SET_INTERVAL, ATTITUDE, 250_000)[0] == mavlink.MAV_RESULT_ACCEPTED
    (message,) = ask(bench, GET_INTERVAL, ATTITUDE)[1]
    assert (message.message_id, message.interval_us) == (ATTITUDE, 250_000)
    ask(bench, SET_INTERVAL, ATTITUDE, -1)
    (message,) = ask(bench, REQUEST, mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL, ATTITUDE)[1]
    assert message.interval_us == -1


def test_interval_of_an_unknown_message_is_refused() -> None:
    bench = whole_bench()
    assert ask(bench, SET_INTERVAL, 11_000, 1000)[0] == mavlink.MAV_RESULT_FAILED
    result, (message,) = ask(bench, GET_INTERVAL, 11_000)
    assert (result, message.interval_us) == (mavlink.MAV_RESULT_FAILED, 0)


@each("interval_us", [nan, inf, -2.0, 0.5])
def test_senseless_interval_is_denied(interval_us: float) -> None:
    bench = whole_bench()
    assert ask(bench, SET_INTERVAL, ATTITUDE, interval_us)[0] == mavlink.MAV_RESULT_DENIED


def test_enormous_interval_is_taken() -> None:
    bench = whole_bench()
    assert ask(bench, SET_INTERVAL, ATTITUDE, 3e38)[0] == mavlink.MAV_RESULT_ACCEPTED
    (message,) = ask(bench, GET_INTERVAL, ATTITUDE)[1]
    assert message.interval_us == 0x7FFF_FFFF
