"""Rows 55 to 57: one owner at a time, shown to all, and asked before control changes hands."""

from typing import Any

import pytest

from gateways.mavlink.commands.command_protocol import CommandService
from gateways.mavlink.commands.control_commands import OperatorCommands
from gateways.mavlink.commands.vehicle_commands import ArmingCommands
from gateways.mavlink.mav_service import WATCHER, Sender
from gateways.mavlink.mav_vehicle import Face
from gateways.mavlink.mavlink_dialect import RESULT_NOT_IN_CONTROL, MavMessage, mavlink
from gateways.mavlink.operator_control import SILENCE_NS
from gateways.mavlink.streams import StreamScheduler
from ground.client.operations.commands import Arm
from protocol.wire.enums import LeaseAction
from protocol.wire.messages import LeaseStatus
from tests.support.gateway.fake_port import CLIENT, IDENTITY, OTHER, Bench
from tests.support.gateway.messages import acks, command, words

CONTROL = 32100
ACCEPTED, DENIED, FAILED = 0, 2, 4
MANAGER, TAKEOVER = 1, 2


def lease(holder: str, name: str = "ada") -> LeaseStatus:
    return LeaseStatus(time_ns=0, lapses_ms=900, held=1, holder=holder, name=name)


class ControlBench(Bench):
    def __init__(self) -> None:
        super().__init__()
        control = OperatorCommands(self.vehicle)
        commands = CommandService(self.vehicle, ArmingCommands(self.vehicle).table, control.table)
        self.face = Face(self.vehicle, [StreamScheduler(self.vehicle), control, commands])
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


def test_status_is_sent_each_second_and_at_once(bench: ControlBench) -> None:
    found = states(bench.after(3.0))
    assert 2 * 3 <= len(found) <= 2 * 4 + 1
    assert set(found) == {(MANAGER | TAKEOVER, 0)}
    assert bench.result(CLIENT) == ACCEPTED
    assert states(bench.after(0.02))[0] == (MANAGER, 255)
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
    bench.face.receive(message, OTHER, bench.now_ns)
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
