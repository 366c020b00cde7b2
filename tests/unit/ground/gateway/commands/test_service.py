from math import inf, nan

import pytest

from gateways.mavlink.commands.command_protocol import MAX_STOPS, MAX_WAITING, RESULTS
from gateways.mavlink.mav_service import WATCHER
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.services import face_of
from ground.client.operations.commands import Arm, Disarm, Hold, SetMode
from ground.client.results import Refused
from protocol.wire.enums import Mode
from protocol.wire.reasons import Reason
from tests.support.gateway.fake_port import CLIENT, OTHER, Bench
from tests.support.gateway.messages import acks, command, command_int, numbered, words

ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
SET_MODE = mavlink.MAV_CMD_DO_SET_MODE
ACCEPTED, LATER, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.after(0.02)
    return bench


def mode_message(mode: int, base_mode: int = 1) -> MavMessage:
    return numbered(mavlink.MAVLink_set_mode_message(1, base_mode, mode))


def test_unknown_command_is_unsupported_at_once(bench: Bench) -> None:
    assert acks(bench.send(command(3000))) == [(3000, UNSUPPORTED)]
    assert acks(bench.send(command_int(0xFFFF))) == [(0xFFFF, UNSUPPORTED)]


def test_ack_goes_to_the_sender_only(bench: Bench) -> None:
    bench.face.receive(command(ARM, 1), OTHER, 0)
    bench.port.answer()
    sends = bench.vehicle.outbox.take()
    assert [(one.client, one.message.target_system) for one in sends] == [(2, 254)]
    assert sends[0].message.target_component == OTHER.component


def test_ack_waits_for_the_robot(bench: Bench) -> None:
    assert acks(bench.send(command(ARM, 1))) == []
    bench.port.answer()
    assert acks(bench.sent()) == [(ARM, ACCEPTED)]


def test_ack_is_sent_twice_on_a_lossy_line(bench: Bench) -> None:
    bench.vehicle.lossy = {CLIENT.client}
    bench.send(command(ARM, 1))
    bench.port.answer()
    assert acks(bench.sent()) == 2 * [(ARM, ACCEPTED)]
    request = mavlink.MAV_CMD_REQUEST_MESSAGE
    assert acks(bench.send(command(request, 1e5))) == [(request, UNSUPPORTED)]


def test_command_int_is_carried_out_like_command_long(bench: Bench) -> None:
    bench.send(command_int(ARM, 1))
    assert bench.port.performed == [Arm()]


def test_command_for_another_vehicle_is_ignored(bench: Bench) -> None:
    message = command(ARM, 1)
    message.target_system = 2
    assert bench.send(message) == []
    assert bench.port.performed == []


def test_any_target_zero_is_ours(bench: Bench) -> None:
    message = command(ARM, 1)
    message.target_system = message.target_component = 0
    bench.send(message)
    assert bench.port.performed == [Arm()]


def test_copy_of_a_frame_acts_once(bench: Bench) -> None:
    message = command(ARM, 1)
    bench.send(message)
    bench.port.answer()
    bench.sent()
    assert acks(bench.send(message)) == [(ARM, ACCEPTED)]
    assert bench.port.performed == [Arm()]


def test_copy_of_a_frame_whose_effect_is_over_has_no_answer(bench: Bench) -> None:
    message = command(ARM, 1)
    bench.send(message)
    bench.port.answer()
    bench.send(command(ARM, 0))
    bench.port.answer()
    bench.sent()
    assert acks(bench.send(message)) == []
    assert bench.port.performed == [Arm(), Disarm()]


def test_repeat_with_confirmation_gets_the_kept_answer(bench: Bench) -> None:
    bench.send(command(ARM, 1))
    bench.port.refuse(Reason.NO_SENSES)
    assert acks(bench.sent()) == [(ARM, LATER)]
    bench.now_ns += 5_000_000_000
    assert acks(bench.send(command(ARM, 1, confirmation=1))) == [(ARM, LATER)]
    assert bench.port.performed == [Arm()]


def test_unmarked_repeat_acts_once(bench: Bench) -> None:
    bench.send(command(ARM, 1))
    assert acks(bench.send(command(ARM, 1))) == []
    bench.port.answer()
    assert acks(bench.sent()) == [(ARM, ACCEPTED)]
    assert acks(bench.send(command(ARM, 1))) == [(ARM, ACCEPTED)]
    assert bench.port.performed == [Arm()]


def test_same_command_acts_again_later(bench: Bench) -> None:
    for _ in range(2):
        bench.send(command(ARM, 1))
        bench.port.answer()
        bench.now_ns += 2_000_000_000
    assert bench.port.performed == [Arm(), Arm()]


def test_same_command_acts_again_after_another(bench: Bench) -> None:
    for value in (1, 0, 1):
        bench.send(command(ARM, value))
        bench.port.answer()
    assert bench.port.performed == [Arm(), Disarm(), Arm()]


def test_stop_is_carried_out_each_time(bench: Bench) -> None:
    for _ in range(3):
        bench.send(command(SET_MODE, 1, Mode.HOLD))
    assert bench.port.performed == [Hold()] * 3


def test_commands_of_another_client_are_not_repeats(bench: Bench) -> None:
    bench.send(command(ARM, 1))
    bench.port.answer()
    bench.sent()
    sent = bench.send(command(ARM, 1), OTHER)
    assert acks(sent) == [(ARM, 10)]
    assert "MAVLink 255" in words(sent)


def test_lease_of_another_operator_is_not_in_control(bench: Bench) -> None:
    bench.port.holder = "ada"
    sent = bench.send(command(ARM, 1))
    assert acks(sent) == [(ARM, 10)]
    assert "ada" in words(sent)


def test_client_that_may_only_watch_is_denied(bench: Bench) -> None:
    sent = bench.send(command(ARM, 1), CLIENT._replace(barred=WATCHER))
    assert acks(sent) == [(ARM, DENIED)]
    assert "sign" in words(sent)


def test_too_many_waiting_commands_are_rejected(bench: Bench) -> None:
    for mode in (Mode.MANUAL, Mode.SMART_RTL) * (MAX_WAITING // 2):
        bench.send(command(SET_MODE, 1, mode, len(bench.port.performed)))
    assert acks(bench.send(command(SET_MODE, 1, Mode.MANUAL, 99))) == [(SET_MODE, LATER)]
    bench.send(command(ARM, 0))
    assert bench.port.performed[-1] == Disarm()


def test_limit_counts_all_system_ids_of_a_client(bench: Bench) -> None:
    for number in range(MAX_WAITING + 4):
        sender = CLIENT._replace(system=10 + number)
        bench.send(command(SET_MODE, 1, Mode.HOLD), sender)
    assert len(bench.port.performed) == MAX_WAITING + 4  # stops have a higher limit
    for number in range(2 * MAX_STOPS):
        bench.send(command(SET_MODE, 1, Mode.HOLD), CLIENT._replace(system=60 + number))
    assert len(bench.port.performed) == MAX_STOPS
    bench.send(command(SET_MODE, 1, Mode.HOLD), OTHER)
    assert len(bench.port.performed) == MAX_STOPS + 1


def test_emergency_stop_passes_all_that_waits(bench: Bench) -> None:
    for number in range(100):
        bench.send(command(SET_MODE, 1, Mode.HOLD), CLIENT._replace(system=100 + number))
    for count in range(100):
        bench.send(command(185, 1))
        assert len(bench.port.stops) == count + 1


def test_client_with_many_system_ids_repeats_nothing_of_others(bench: Bench) -> None:
    first = command(ARM, 1)
    bench.send(first)
    bench.port.answer()
    for number in range(500):
        sender = OTHER._replace(system=1 + number % 250, component=number // 250)
        bench.send(command(SET_MODE, 1, Mode.GUIDED), sender)
    bench.send(first)
    assert bench.port.performed == [Arm()]


def test_robot_that_does_not_answer_is_a_failure(bench: Bench) -> None:
    bench.send(command(ARM, 1))
    bench.port.answer(error="r1 does not answer")
    sent = bench.sent()
    assert acks(sent) == [(ARM, FAILED)]
    assert "does not answer" in words(sent)


def test_refusals_in_words_are_limited(bench: Bench) -> None:
    sent = [one for _ in range(50) for one in bench.send(command(3000))]
    assert len(acks(sent)) == 50
    assert len([one for one in sent if one.get_type() == "STATUSTEXT"]) == 1
    flood = [one for number in range(3001, 3100) for one in bench.send(command(number))]
    assert len(flood) < 120


def test_set_mode_message_is_acknowledged_as_such(bench: Bench) -> None:
    bench.send(mode_message(Mode.MANUAL))
    bench.port.answer()
    assert bench.port.performed == [SetMode(mode=Mode.MANUAL)]
    assert acks(bench.sent()) == [(mavlink.MAVLINK_MSG_ID_SET_MODE, ACCEPTED)]


def test_set_mode_without_custom_mode_is_denied(bench: Bench) -> None:
    assert acks(bench.send(mode_message(Mode.MANUAL, base_mode=0))) == [(11, DENIED)]


@pytest.mark.parametrize("value", [nan, inf, -inf, 65535.0, 0.5, -1.0])
@pytest.mark.parametrize("number", [176, 178, 185, 193, 194, 300, 400])
def test_hostile_parameters_are_answered(bench: Bench, number: int, value: float) -> None:
    sent = bench.send(command(number, *[value] * 7))
    assert acks(sent) or bench.port.performed or bench.port.stops


def test_every_reason_has_a_result() -> None:
    assert set(RESULTS) == set(Reason)
    assert [reason for reason, result in RESULTS.items() if result == ACCEPTED] == [Reason.NONE]


def test_refusal_names_its_reason(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH))
    bench.port.answer(Refused(Reason.NO_TRAIL, 1))
    sent = bench.sent()
    assert acks(sent) == [(20, FAILED)]
    assert "no trail" in words(sent)
