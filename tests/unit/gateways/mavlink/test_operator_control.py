"""Operator control: one owner at a time, shown to all, and asked before it changes hands."""

import asyncio
from collections.abc import Callable
from math import nan
from typing import Any

import pytest

from checks.harness.played_gateway import LOOP
from gateways.mavlink.commands.command_protocol import CommandService
from gateways.mavlink.commands.control_commands import OperatorCommands
from gateways.mavlink.commands.vehicle_commands import ArmingCommands
from gateways.mavlink.liveness import ClockSync
from gateways.mavlink.mav_service import WATCHER, Sender
from gateways.mavlink.mav_vehicle import Face
from gateways.mavlink.mavlink_dialect import (
    RESULT_NOT_IN_CONTROL,
    ControlStatus,
    MavMessage,
    mavlink,
)
from gateways.mavlink.operator_control import BUSY, MAX_TAKING, SILENCE_NS, held_by
from gateways.mavlink.robot_port import OVERTAKEN, Answered
from gateways.mavlink.streams import MessageRequests, StreamScheduler
from ground.client.outcomes import Accepted, Refused
from ground.commands.arm import Arm
from ground.commands.fence import ShowFence
from ground.commands.hold import Hold
from ground.commands.resume import Resume
from protocol.wire.enums import LeaseAction
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.gateway.fake_port import (
    CLIENT,
    IDENTITY,
    OTHER,
    Bench,
    acks,
    command,
    words,
)

CONTROL = 32100
ACCEPTED, DENIED, FAILED = 0, 2, 4
MANAGER, TAKEOVER = 1, 2


def lease(holder: str, name: str = "ada") -> LeaseStatus:
    return LeaseStatus(time_ns=0, lapses_ms=900, held=1, holder=holder, name=name)


class ControlBench(Bench):
    def __init__(self) -> None:
        super().__init__()
        scheduler = StreamScheduler(self.vehicle)
        control = OperatorCommands(self.vehicle, scheduler)
        requests = MessageRequests(self.vehicle, scheduler)
        tables = ArmingCommands(self.vehicle).table, control.table, requests.table
        commands = CommandService(self.vehicle, *tables)
        self.face = Face(self.vehicle, [control, scheduler, commands])
        self.face.join(CLIENT.client)
        self.face.join(OTHER.client)

    def asks(self, sender: Sender, action: float = 1, takeover: float = 0) -> list[MavMessage]:
        message = command(CONTROL, action, takeover, 10, sender.system)
        return self.send(message, sender)

    def result(self, sender: Sender, action: float = 1, takeover: float = 0) -> int:
        ((number, result),) = acks(self.asks(sender, action, takeover))
        assert number == CONTROL
        return result


@pytest.fixture
def bench() -> ControlBench:
    return ControlBench()


def states(messages: list[MavMessage]) -> list[tuple[int, int]]:
    return [(one.flags, one.gcs_main) for one in messages if one.get_type() == "CONTROL_STATUS"]


def questions(messages: list[MavMessage]) -> list[Any]:
    return [one for one in messages if one.get_type() == "COMMAND_LONG"]


def test_status_goes_only_to_clients_that_have_asked_for_it(bench: ControlBench) -> None:
    """Others count each one as a lost frame, because it is missing in their dialects."""
    assert states(bench.after(3.0)) == []
    bench.send(command(511, ControlStatus.id, 1e6), OTHER)
    found = states(bench.after(3.0))
    assert 3 <= len(found) <= 4
    assert set(found) == {(MANAGER | TAKEOVER, 0)}
    bench.send(command(511, ControlStatus.id, -1), OTHER)
    bench.send(command(400, 1))
    assert states(bench.after(3.0)) == []
    (once,) = states(bench.send(command(512, ControlStatus.id), OTHER))
    assert once == (MANAGER | TAKEOVER, 255)


def test_status_is_sent_each_second_and_at_once(bench: ControlBench) -> None:
    assert bench.result(CLIENT) == ACCEPTED
    assert states(bench.after(0.02)) == [(MANAGER, 255)]
    assert 2 <= len(states(bench.after(2.0))) <= 3
    assert bench.result(CLIENT, takeover=1) == ACCEPTED
    assert states(bench.after(0.02)) == [(MANAGER | TAKEOVER, 255)]
    assert bench.port.leases == [(LeaseAction.TAKE, "MAVLink 255")]


def test_takeover_without_asking_passes_control(bench: ControlBench) -> None:
    assert bench.result(CLIENT, takeover=1) == ACCEPTED
    found = bench.asks(OTHER)
    assert acks(found) == [(CONTROL, ACCEPTED)]
    assert "MAVLink 254 has taken control" in words(found)
    assert bench.vehicle.control.holds(OTHER)
    assert not bench.vehicle.control.holds(CLIENT)
    assert states(bench.after(0.02))[0] == (MANAGER, 254)


def test_owner_is_asked_and_may_permit_or_release(bench: ControlBench) -> None:
    bench.asks(CLIENT)
    bench.vehicle.outbox.take()
    message = command(CONTROL, 1, 0, 10, OTHER.system)
    bench.receive(message, OTHER)
    sends = bench.vehicle.outbox.take()
    (question,) = [one for one in sends if one.message.get_type() == "COMMAND_LONG"]
    assert question.client == CLIENT.client
    asked = question.message
    assert (asked.target_system, asked.command) == (CLIENT.system, CONTROL)
    assert (asked.param1, asked.param3, asked.param4) == (1, 10, OTHER.system)
    assert acks([one.message for one in sends]) == [(CONTROL, FAILED)]
    assert "MAVLink 255 has control" in words([one.message for one in sends])
    assert bench.result(CLIENT, takeover=1) == ACCEPTED
    assert bench.result(OTHER) == ACCEPTED
    assert bench.result(CLIENT, action=0) == RESULT_NOT_IN_CONTROL
    assert bench.result(OTHER, action=0) == ACCEPTED
    assert bench.port.leases[-1][0] == LeaseAction.RELEASE
    assert bench.vehicle.control.owner is None


def test_owner_is_asked_again_only_after_ten_seconds(bench: ControlBench) -> None:
    def keep(seconds: int) -> None:
        for _ in range(seconds):
            bench.after(1.0)
            bench.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    bench.asks(CLIENT)
    assert len(questions(bench.asks(OTHER))) == 1
    keep(9)
    assert questions(bench.asks(OTHER)) == []
    keep(1)
    assert len(questions(bench.asks(OTHER))) == 1


def test_commands_of_others_are_not_in_control(bench: ControlBench) -> None:
    bench.asks(CLIENT)
    assert acks(bench.send(command(400, 1), OTHER)) == [(400, RESULT_NOT_IN_CONTROL)]
    bench.send(command(185, 1), OTHER)
    assert len(bench.port.stops) == 1
    assert bench.port.performed == []
    bench.send(command(400, 1), CLIENT)
    assert bench.port.performed == [Arm()]


def test_operator_on_the_bus_is_shown_as_the_owner(bench: ControlBench) -> None:
    bench.send(command(511, ControlStatus.id, 1e6))
    bench.port.holder = "ada"
    bench.port.telemetry["lease"] = lease("ground/7")
    assert states(bench.after(0.02))[0] == (MANAGER, bench.vehicle.system)
    found = bench.asks(CLIENT)
    assert acks(found) == [(CONTROL, FAILED)]
    assert "ada" in words(found)
    assert questions(found) == []


def test_operator_on_the_bus_who_seizes_the_lease_is_the_owner(bench: ControlBench) -> None:
    bench.asks(CLIENT)
    bench.port.telemetry["lease"] = lease(IDENTITY, "MAVLink 255")
    bench.after(1.0)
    assert bench.vehicle.control.holds(CLIENT)
    bench.port.telemetry["lease"] = lease("ground/7")
    assert (MANAGER, bench.vehicle.system) in states(bench.after(0.1))
    assert bench.vehicle.control.owner is None


def test_client_that_vanishes_loses_control(bench: ControlBench) -> None:
    bench.asks(CLIENT)
    found = states(bench.after(SILENCE_NS / 1e9 + 0.1))
    assert found[-1] == (MANAGER | TAKEOVER, 0)
    beats = bench.port.heartbeats
    bench.after(1.0)
    assert bench.port.heartbeats == beats
    assert bench.result(OTHER) == ACCEPTED


def test_unsigned_frames_of_the_owner_keep_no_control(bench: ControlBench) -> None:
    bench.asks(CLIENT)
    for _ in range(6):
        forged = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
        bench.send(forged, CLIENT._replace(barred=WATCHER))
        bench.after(1.0)
    assert bench.vehicle.control.owner is None


@pytest.mark.parametrize(
    "params", [(1, 0, 10, 7), (2, 0, 10, 255), (float("nan"), 0, 10, 255), (1, 9, 10, 255)]
)
def test_bad_request_for_control_is_denied(bench: ControlBench, params: tuple[float, ...]) -> None:
    found = bench.send(command(CONTROL, *params))
    assert acks(found) == [(CONTROL, DENIED)]
    assert "parameter" in words(found)
    assert bench.port.leases == []


def test_client_that_may_only_watch_gets_no_control(bench: ControlBench) -> None:
    assert acks(bench.asks(CLIENT._replace(barred=WATCHER))) == [(CONTROL, DENIED)]
    assert bench.port.leases == []


HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def reason_of(answer: Answered) -> int:
    assert isinstance(answer.outcome, Refused)
    return answer.outcome.reason


def test_first_command_takes_the_lease() -> None:
    bench, answers = Bench(), list[Answered]()
    bench.perform(CLIENT, Arm(), answers)
    assert bench.port.leases == [(LeaseAction.TAKE, "MAVLink 255")]
    bench.port.answer()
    assert answers[0].ok
    assert bench.port.heartbeats == 1


def test_command_of_another_client_is_refused() -> None:
    bench, answers = Bench(), list[Answered]()
    bench.perform(CLIENT, Arm(), answers)
    bench.perform(OTHER, Arm(), answers)
    assert reason_of(answers[0]) == Reason.LEASE_HELD
    assert "MAVLink 255" in answers[0].text


def test_command_that_waits_is_refused_once_another_client_has_control() -> None:
    bench = Bench()
    bench.perform(CLIENT, Arm())
    bench.perform(CLIENT, ShowFence())
    arming, reading = bench.port.refusals
    assert arming() is None
    LOOP.run(bench.vehicle.control.request(OTHER, allow_takeover=True))
    assert arming() == held_by(OTHER, CLIENT).outcome
    assert reading() is None


SAME = OTHER._replace(system=CLIENT.system)


@each("remote", [CLIENT, SAME, None])
def test_stranger_with_the_same_ids_gets_no_control(remote: Sender | None) -> None:
    """Only a signature, or the same computer, tells that it is the same station."""
    bench, answers = Bench(), list[Answered]()
    owner = CLIENT._replace(is_loopback=remote is SAME)
    stranger = SAME._replace(is_loopback=remote is CLIENT)
    bench.perform(owner, Arm(), answers)
    bench.perform(stranger, Arm(), answers)
    assert reason_of(answers[0]) == Reason.LEASE_HELD
    assert answers[0].text.startswith("the same ids 255/190 are in control from another address")
    bench.after(SILENCE_NS / 1e9 - 0.1)
    bench.perform(stranger, Arm(), answers)
    assert not answers[1].ok
    assert bench.vehicle.control.holds(owner)


@each("back", [SAME, SAME._replace(is_loopback=False, is_signed=True)])
@each("quiet_s", [0.0, 0.5, 1.0, 3.0])
def test_client_that_is_back_at_another_address_gets_control(back: Sender, quiet_s: float) -> None:
    bench, answers = Bench(), list[Answered]()
    bench.perform(CLIENT, Arm())
    bench.port.answer()
    bench.after(quiet_s)
    bench.send(HEARTBEAT, back)
    bench.perform(back, Hold(), answers)
    bench.perform(back, Resume(), answers)
    told = bench.after(0.75)
    assert bench.vehicle.control.holds(back)
    assert bench.port.performed == [Arm(), Hold(), Resume()]
    assert len(bench.port.leases) == 1, "the robot's lease stays with the gateway"
    assert "the same ids from another address have taken control" in words(told)


@each("sign_of_life", ["heartbeat", "answer"])
def test_station_that_lives_keeps_control_from_its_twin(sign_of_life: str) -> None:
    bench, answers = Bench(ClockSync), list[Answered]()
    bench.perform(CLIENT, Arm())
    bench.after(0.7)
    bench.perform(SAME, Arm(), answers)
    assert answers == []
    asked = bench.after(0.1)
    assert [one.get_type() for one in asked].count("PING") == 1
    answer = mavlink.MAVLink_ping_message(0, 1, 1, 1)
    bench.send(HEARTBEAT if sign_of_life == "heartbeat" else answer)
    bench.after(0.02)
    assert reason_of(answers[0]) == Reason.LEASE_HELD
    assert "give each ground station ids of its own" in answers[0].text
    assert bench.vehicle.control.holds(CLIENT)


@each("component", [0, 191])
def test_text_names_the_component_if_the_system_is_the_same(component: int) -> None:
    bench, answers = Bench(), list[Answered]()
    bench.perform(CLIENT, Arm(), answers)
    bench.perform(SAME._replace(component=component), Arm(), answers)
    assert answers[0].text == "refused: another operator commands the robot: MAVLink 255/190"


def held_leases(bench: Bench) -> list[Callable[[Answered], None]]:
    """Let the robot answer requests for the lease when the test calls what is returned."""
    granted: list[Callable[[Answered], None]] = []

    async def held(action: LeaseAction, name: str) -> Answered:
        end: asyncio.Future[Answered] = asyncio.get_running_loop().create_future()
        granted.append(end.set_result)
        return await end

    bench.port.change_lease = held  # type: ignore[method-assign]
    return granted


def test_what_waited_for_control_moves_nothing_after_a_stop() -> None:
    bench, answers = Bench(), list[Answered]()
    granted = held_leases(bench)
    bench.perform(CLIENT, Resume(), answers)
    bench.perform(OTHER, Hold(), answers)
    granted[0](Answered(Accepted(1)))
    bench.settle()
    assert bench.port.performed == [Hold()]
    assert [one.error for one in answers] == [OVERTAKEN]


def test_command_that_only_stops_needs_no_control() -> None:
    bench, answers = Bench(), list[Answered]()
    bench.perform(CLIENT, Arm(), answers)
    bench.perform(OTHER, Hold(), answers)
    assert bench.port.performed == [Arm(), Hold()]


def test_flood_of_requests_for_control_is_bounded() -> None:
    bench, answers = Bench(), list[Answered]()
    granted = held_leases(bench)
    for number in range(1_000):
        bench.perform(CLIENT._replace(system=number % 250), Arm(), answers)
    assert len(answers) == 1_000 - MAX_TAKING
    assert all(one.error == BUSY for one in answers)
    (grant,) = granted
    grant(Answered(Accepted(1)))
    bench.settle()
    assert bench.port.performed == [Arm()]
    assert len(answers) == 999


def test_lease_of_another_operator_is_named() -> None:
    bench, answers = Bench(), list[Answered]()
    bench.port.holder = "ada"
    bench.perform(CLIENT, Arm(), answers)
    assert "ada" in answers[0].text
    assert bench.port.performed == []


def test_client_that_may_only_watch_commands_nothing() -> None:
    bench, answers = Bench(), list[Answered]()
    bench.perform(CLIENT._replace(barred=WATCHER), Hold(), answers)
    assert not answers[0].ok
    assert not bench.port.performed
    assert not bench.port.leases


def test_heartbeat_to_the_robot_ends_with_the_client() -> None:
    bench = Bench()
    bench.perform(CLIENT, Arm())
    bench.send(HEARTBEAT)
    bench.after(SILENCE_NS / 1e9)
    sent = bench.port.heartbeats
    assert sent >= 15
    told = bench.after(1.0)
    assert bench.port.heartbeats == sent
    assert bench.vehicle.control.owner is None
    told += bench.after(0.6)
    assert "MAVLink 255 was silent for 5.0 s: it has lost control" in words(told)


@each(("back_s", "is_kept"), [(1.4, True), (1.6, False)])
def test_client_that_the_robot_has_not_missed_is_in_control_again(
    back_s: float, is_kept: bool
) -> None:
    bench = Bench()
    bench.perform(CLIENT, Arm())
    bench.after(SILENCE_NS / 1e9 + back_s)
    sent = bench.port.heartbeats
    bench.send(HEARTBEAT)
    assert bench.vehicle.control.holds(CLIENT) == is_kept
    bench.after(1.0)
    assert (bench.port.heartbeats > sent) == is_kept


def test_another_client_gets_control_after_the_silence() -> None:
    bench, answers = Bench(), list[Answered]()
    bench.perform(CLIENT, Arm())
    bench.after(SILENCE_NS / 1e9)
    bench.perform(OTHER, Arm(), answers)
    told = bench.after(0.02)
    assert bench.vehicle.control.holds(OTHER)
    assert "MAVLink 254 has taken control" in words(told)
    bench.send(HEARTBEAT)
    assert bench.vehicle.control.holds(OTHER)


def test_frames_for_other_robots_are_signs_of_life() -> None:
    bench = Bench()
    bench.perform(CLIENT, Arm())
    for _ in range(8):
        bench.after(1.0)
        bench.send(mavlink.MAVLink_param_request_list_message(7, 1))
    assert bench.vehicle.control.holds(CLIENT)


def test_control_is_lost_with_the_lease() -> None:
    bench = Bench()
    bench.perform(CLIENT, Arm())
    lease = LeaseStatus(time_ns=0, lapses_ms=1000, held=1, holder=IDENTITY, name="MAVLink 255")
    bench.port.telemetry["lease"] = lease
    bench.after(1.0)
    assert bench.vehicle.control.holds(CLIENT)
    bench.port.telemetry["lease"] = LeaseStatus(
        time_ns=0, lapses_ms=1000, held=1, holder="ground/7", name="ada"
    )
    bench.after(0.1)
    assert not bench.vehicle.control.holds(CLIENT)


def test_lease_that_another_program_of_the_gateway_took_is_its_own() -> None:
    """Such as the gateway before its restart: the lease belongs to a person."""
    bench = Bench()
    bench.port.telemetry["lease"] = LeaseStatus(
        time_ns=0, lapses_ms=1000, held=1, holder="gateway/6", name="MAVLink 255"
    )
    bench.perform(CLIENT, Arm())
    bench.after(1.0)
    assert not bench.vehicle.control.is_foreign
    assert bench.vehicle.control.holds(CLIENT)


def test_messages_for_others_are_ignored() -> None:
    bench = Bench()
    for system, component, heard in ((0, 0, 1), (1, 1, 1), (2, 1, 0), (1, 2, 0), (0, 1, 1)):
        message = mavlink.MAVLink_command_long_message(system, component, 400, 0, *[nan] * 7)
        assert bench.face._is_target(message) == bool(heard)


# A refused command leaves the lease as it was.


def free() -> LeaseStatus:
    return LeaseStatus(time_ns=0, lapses_ms=0, held=0, holder="", name="")


def test_a_refused_command_gives_the_lease_back_that_it_took(bench: ControlBench) -> None:
    bench.port.telemetry["lease"] = free()
    bench.after(0.1)
    bench.send(command(400, 1))
    bench.port.refuse(Reason.NO_SENSES)
    bench.after(0.1)
    assert [action for action, _ in bench.port.leases] == [LeaseAction.TAKE, LeaseAction.RELEASE]
    assert bench.vehicle.control.owner is None


def test_an_accepted_command_keeps_the_lease(bench: ControlBench) -> None:
    bench.port.telemetry["lease"] = free()
    bench.after(0.1)
    bench.send(command(400, 1))
    bench.port.answer()
    bench.after(0.1)
    assert [action for action, _ in bench.port.leases] == [LeaseAction.TAKE]
    assert bench.vehicle.control.holds(CLIENT)


def test_a_refused_command_keeps_the_lease_that_its_client_had(bench: ControlBench) -> None:
    bench.port.telemetry["lease"] = free()
    assert bench.result(CLIENT) == ACCEPTED
    bench.send(command(400, 1))
    bench.port.refuse(Reason.NO_SENSES)
    bench.after(0.1)
    assert [action for action, _ in bench.port.leases] == [LeaseAction.TAKE]
    assert bench.vehicle.control.holds(CLIENT)


def test_a_refused_command_leaves_the_lease_to_the_same_person(bench: ControlBench) -> None:
    bench.port.telemetry["lease"] = lease(IDENTITY)
    bench.after(0.1)
    bench.send(command(400, 1))
    bench.port.refuse(Reason.NO_SENSES)
    bench.after(0.1)
    assert [action for action, _ in bench.port.leases] == [LeaseAction.TAKE]
    assert bench.vehicle.control.owner is None


def test_release_without_control_says_that_there_was_nothing(bench: ControlBench) -> None:
    found = bench.asks(CLIENT, action=0)
    assert acks(found) == [(CONTROL, ACCEPTED)]
    assert "nobody had the lease: there was nothing to give back" in words(found)
