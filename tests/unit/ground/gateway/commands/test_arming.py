from math import nan

import pytest

from gateways.mavlink.mav_service import WATCHER
from gateways.mavlink.services import face_of
from ground.client.operations.commands import Arm, ClearEmergencyStop, Disarm
from protocol.wire.enums import Vehicle
from protocol.wire.reasons import Reason
from tests.support.gateway.fake_port import CLIENT, OTHER, Bench
from tests.support.gateway.messages import acks, command, words
from tests.support.gateway.telemetry import everything, status

ARM, CHECKS, STOP = 400, 401, 185
ACCEPTED, LATER, DENIED, FAILED, NOT_IN_CONTROL = 0, 1, 2, 4, 10


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    show(bench, Vehicle.STANDBY)
    return bench


def show(bench: Bench, vehicle: Vehicle, reason: Reason = Reason.NONE) -> None:
    shown = status(vehicle=vehicle, vehicle_reason=reason, stop_id=7)
    bench.port.telemetry |= everything() | {"status": shown}
    bench.after(0.02)


def test_refused_arming_is_a_prearm_text(bench: Bench) -> None:
    bench.send(command(ARM, 1))
    bench.port.refuse(Reason.FENCE_UNREADABLE)
    sent = bench.sent()
    assert acks(sent) == [(ARM, FAILED)]
    assert words(sent).startswith("PreArm: the saved fence cannot be read")


def test_arming_in_an_emergency_stop_names_the_way_out(bench: Bench) -> None:
    show(bench, Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR)
    bench.send(command(ARM, 1))
    bench.port.refuse(Reason.EMERGENCY_STOPPED)
    assert "command 185 with 0 clears it" in words(bench.sent())


@pytest.mark.parametrize("force", [2989, 21196])
def test_forced_arming_clears_the_emergency_stop(bench: Bench, force: int) -> None:
    show(bench, Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR)
    bench.send(command(ARM, 1, force))
    bench.port.answer()
    bench.port.answer()
    assert bench.port.performed == [ClearEmergencyStop(stop_ids=(7,)), Arm()]
    assert acks(bench.sent()) == [(ARM, ACCEPTED)]


def test_forced_arming_without_control_clears_nothing(bench: Bench) -> None:
    show(bench, Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR)
    bench.port.holder = "ada"
    sent = bench.send(command(ARM, 1, 21196))
    assert acks(sent) == [(ARM, NOT_IN_CONTROL)]
    assert bench.port.performed == []


def test_forced_arming_otherwise_only_arms(bench: Bench) -> None:
    bench.send(command(ARM, 1, 21196))
    assert bench.port.performed == [Arm()]


@pytest.mark.parametrize("force", [0, 2989, 21196])
@pytest.mark.parametrize("holder", ["", "ada"])
def test_disarming_needs_no_control(bench: Bench, force: int, holder: str) -> None:
    bench.send(command(ARM, 1), CLIENT)
    bench.port.answer()
    bench.sent()
    bench.port.holder = holder
    bench.send(command(ARM, 0, force), OTHER)
    assert bench.port.performed == [Arm(), Disarm()]
    bench.port.answer()
    assert acks(bench.sent()) == [(ARM, ACCEPTED)]
    assert len(bench.port.leases) == 1


def test_emergency_stop_is_open_to_all(bench: Bench) -> None:
    bench.send(command(ARM, 1), CLIENT)
    bench.sent()
    bench.send(command(STOP, 1), OTHER)
    bench.port.stops[0](bench.port.accepted)
    assert acks(bench.sent()) == [(STOP, ACCEPTED)]


def test_emergency_stop_is_repeated_each_time(bench: Bench) -> None:
    for _ in range(3):
        bench.send(command(STOP, 1))
    assert len(bench.port.stops) == 3


def test_emergency_stop_needs_a_client_that_may_command(bench: Bench) -> None:
    sent = bench.send(command(STOP, 1), CLIENT._replace(barred=WATCHER))
    assert acks(sent) == [(STOP, DENIED)]
    assert bench.port.stops == []


def test_termination_with_zero_clears_the_stop(bench: Bench) -> None:
    show(bench, Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR)
    bench.send(command(STOP, 0))
    bench.port.answer()
    assert bench.port.performed == [ClearEmergencyStop(stop_ids=(7,))]
    assert acks(bench.sent()) == [(STOP, ACCEPTED)]


def test_a_client_clears_its_own_stop_before_the_status_shows_it(bench: Bench) -> None:
    """The robot may acknowledge a stop by datagram before its status arrives."""
    show(bench, Vehicle.ACTIVE)
    bench.send(command(STOP, 1))
    bench.send(command(STOP, 0))
    bench.port.answer()
    assert bench.port.performed == [ClearEmergencyStop(stop_ids=(7, 101))], "and no newer one"


def test_a_clear_names_the_stop_seen_last_while_no_status_arrives(bench: Bench) -> None:
    """Another stop may be pressed before the clear is sent."""
    show(bench, Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR)
    del bench.port.telemetry["status"]
    bench.after(0.3)
    bench.send(command(STOP, 0))
    bench.port.answer()
    assert bench.port.performed == [ClearEmergencyStop(stop_ids=(7,))]


def test_a_clear_before_the_first_status_waits_for_one() -> None:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    assert acks(bench.send(command(STOP, 0))) == [(STOP, LATER)]
    assert bench.port.performed == []


@pytest.mark.parametrize("value", [nan, -1.0, 0.25])
def test_termination_with_other_values_is_denied(bench: Bench, value: float) -> None:
    assert acks(bench.send(command(STOP, value))) == [(STOP, DENIED)]
    assert bench.port.stops == []
    assert bench.port.performed == []


@pytest.mark.parametrize(
    ("vehicle", "reason", "expected"),
    [
        (Vehicle.BOOT, Reason.NONE, "PreArm: no fresh wheel ticks"),
        (Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR, "PreArm: emergency stop is latched"),
        (Vehicle.FAILSAFE, Reason.BUMPER, ""),
        (Vehicle.STANDBY, Reason.FENCE_UNREADABLE, "PreArm: the saved fence"),
        (Vehicle.STANDBY, Reason.NONE, ""),
    ],
)
def test_prearm_checks(bench: Bench, vehicle: Vehicle, reason: Reason, expected: str) -> None:
    show(bench, vehicle, reason)
    sent = bench.send(command(CHECKS))
    assert acks(sent) == [(CHECKS, ACCEPTED)]
    assert words(sent).startswith(expected)
    assert bool(words(sent)) == bool(expected)


def test_prearm_checks_of_a_silent_robot(bench: Bench) -> None:
    del bench.port.telemetry["status"]
    bench.after(0.02)
    assert "no telemetry" in words(bench.send(command(CHECKS)))


def test_prearm_checks_of_an_armed_robot_are_rejected(bench: Bench) -> None:
    show(bench, Vehicle.ACTIVE)
    assert acks(bench.send(command(CHECKS))) == [(CHECKS, LATER)]
