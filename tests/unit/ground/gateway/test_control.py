from math import nan

from ground.client.operations import Arm, Hold
from ground.client.results import Accepted, Refused
from ground.gateway.control import BUSY, MAX_TAKING, SILENCE_NS
from ground.gateway.dialect import mavlink
from ground.gateway.port import Answered, Done
from ground.gateway.traffic import WATCHER
from protocol.wire.enums import LeaseAction
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from tests.support.gateway.fake_port import CLIENT, IDENTITY, OTHER, Bench

HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def reason_of(answer: Answered) -> int:
    assert isinstance(answer.outcome, Refused)
    return answer.outcome.reason


def test_first_command_takes_the_lease() -> None:
    bench, answers = Bench(), list[Answered]()
    bench.vehicle.perform(CLIENT, Arm(), answers.append)
    assert bench.port.leases == [(LeaseAction.TAKE, "MAVLink 255")]
    bench.port.answer()
    assert answers[0].ok
    assert bench.port.heartbeats == 1


def test_command_of_another_client_is_refused() -> None:
    bench, answers = Bench(), list[Answered]()
    bench.vehicle.perform(CLIENT, Arm(), answers.append)
    bench.vehicle.perform(OTHER, Arm(), answers.append)
    assert reason_of(answers[0]) == Reason.LEASE_HELD
    assert "MAVLink 255" in answers[0].text


def test_same_system_id_at_another_peer_is_refused() -> None:
    bench, answers = Bench(), list[Answered]()
    bench.vehicle.perform(CLIENT, Arm(), answers.append)
    bench.vehicle.perform(OTHER._replace(system=CLIENT.system), Arm(), answers.append)
    assert reason_of(answers[0]) == Reason.LEASE_HELD


def test_command_that_only_stops_needs_no_control() -> None:
    bench, answers = Bench(), list[Answered]()
    bench.vehicle.perform(CLIENT, Arm(), answers.append)
    bench.vehicle.perform(OTHER, Hold(), answers.append)
    assert bench.port.performed == [Arm(), Hold()]


def test_flood_of_requests_for_control_is_bounded() -> None:
    bench, answers = Bench(), list[Answered]()
    granted: list[Done] = []
    bench.port.change_lease = lambda *given: granted.append(given[2])  # type: ignore[method-assign]
    for number in range(1_000):
        bench.vehicle.perform(CLIENT._replace(system=number % 250), Arm(), answers.append)
    assert len(answers) == 1_000 - MAX_TAKING
    assert all(one.error == BUSY for one in answers)
    (grant,) = granted
    grant(Answered(Accepted(1)))
    assert bench.port.performed == [Arm()]
    assert len(answers) == 999


def test_lease_of_another_operator_is_named() -> None:
    bench, answers = Bench(), list[Answered]()
    bench.port.holder = "ada"
    bench.vehicle.perform(CLIENT, Arm(), answers.append)
    assert "ada" in answers[0].text
    assert bench.port.performed == []


def test_client_that_may_only_watch_commands_nothing() -> None:
    bench, answers = Bench(), list[Answered]()
    bench.vehicle.perform(CLIENT._replace(barred=WATCHER), Hold(), answers.append)
    assert not answers[0].ok
    assert not bench.port.performed
    assert not bench.port.leases


def test_heartbeat_to_the_robot_ends_with_the_client() -> None:
    bench = Bench()
    bench.vehicle.perform(CLIENT, Arm(), lambda _: None)
    bench.send(HEARTBEAT)
    bench.after(SILENCE_NS / 1e9)
    sent = bench.port.heartbeats
    assert sent >= 15
    bench.after(1.0)
    assert bench.port.heartbeats == sent
    assert bench.vehicle.control.owner is None


def test_control_is_lost_with_the_lease() -> None:
    bench = Bench()
    bench.vehicle.perform(CLIENT, Arm(), lambda _: None)
    lease = LeaseStatus(time_ns=0, lapses_ms=1000, held=1, holder=IDENTITY, name="MAVLink 255")
    bench.port.telemetry["lease"] = lease
    bench.after(1.0)
    assert bench.vehicle.control.holds(CLIENT)
    bench.port.telemetry["lease"] = LeaseStatus(
        time_ns=0, lapses_ms=1000, held=1, holder="ground/7", name="ada"
    )
    bench.after(0.1)
    assert not bench.vehicle.control.holds(CLIENT)


def test_messages_for_others_are_ignored() -> None:
    bench = Bench()
    for system, component, heard in ((0, 0, 1), (1, 1, 1), (2, 1, 0), (1, 2, 0), (0, 1, 1)):
        message = mavlink.MAVLink_command_long_message(system, component, 400, 0, *[nan] * 7)
        assert bench.face._is_target(message) == bool(heard)
