"""TIMESYNC, PING, and the robot's texts."""

from gateways.mavlink.liveness import ClockSync, RobotTexts
from gateways.mavlink.mavlink_dialect import TimeSync, mavlink
from protocol.wire.enums import Severity
from protocol.wire.messages import Statustext
from protocol.wire.statustext import pieces_of
from tests.support.gateway.fake_port import CLIENT, OTHER, Bench


def test_timesync_is_answered_to_its_sender_in_the_time_of_the_messages() -> None:
    bench = Bench(ClockSync)
    bench.after(2.0)
    bench.face.receive(TimeSync(0, 77), CLIENT, bench.now_ns)
    (send,) = bench.vehicle.outbox.take()
    answer = send.message
    assert (send.client, answer.ts1, answer.tc1) == (CLIENT.client, 77, 2_000_000_000)
    assert (answer.target_system, answer.target_component) == (CLIENT.system, CLIENT.component)


def test_answer_of_timesync_to_others_is_ignored() -> None:
    assert Bench(ClockSync).send(TimeSync(5, 77)) == []


def test_timesync_with_and_without_its_target_is_understood() -> None:
    encoder = mavlink.MAVLink(None, 255, 190)
    old = mavlink.MAVLink_timesync_message(0, 9)
    for request in (old, TimeSync(0, 9, 1, 1)):
        (found,) = mavlink.MAVLink(None).parse_buffer(request.pack(encoder))
        assert (found.tc1, found.ts1) == (0, 9)
        (answer,) = Bench(ClockSync).send(found)
        assert answer.ts1 == 9


def test_ping_is_answered_unchanged() -> None:
    bench = Bench(ClockSync)
    (answer,) = bench.send(mavlink.MAVLink_ping_message(123, 7, 0, 0), OTHER)
    assert (answer.time_usec, answer.seq) == (123, 7)
    assert (answer.target_system, answer.target_component) == (OTHER.system, OTHER.component)
    assert bench.send(mavlink.MAVLink_ping_message(123, 7, 1, 1)) == []


def test_texts_of_the_robot_reach_all_clients() -> None:
    bench = Bench(RobotTexts)
    words = "wheel stuck: " + 60 * "x"
    bench.port.texts = [
        Statustext(severity=Severity.WARNING, text="slipping"),
        *pieces_of(words, 9, Severity.ERROR),
    ]
    found = bench.after(0.04)
    assert (found[0].severity, found[0].text) == (Severity.WARNING, "slipping")
    assert "".join(one.text for one in found[1:]) == words
    assert {one.severity for one in found[1:]} == {Severity.ERROR}
    assert [one.chunk_seq for one in found[1:]] == [0, 1]
