"""COMMAND_LONG and COMMAND_INT: accepted, repeated from memory, and followed up."""

from collections import deque
from collections.abc import Callable
from math import inf, nan
from random import Random

import pytest

from gateways.mavlink.commands.command_protocol import MAX_STOPS, MAX_WAITING, RESULTS
from gateways.mavlink.coordinates import PER_DEG
from gateways.mavlink.mav_service import WATCHER, Sender
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.services import face_of
from ground.client.goal import Destination
from ground.client.outcomes import Refused
from ground.commands.arm import Arm
from ground.commands.disarm import Disarm
from ground.commands.goto import Goto
from ground.commands.hold import Hold
from ground.commands.mode import SetMode
from ground.commands.restart import Restart
from ground.commands.rtl import ReturnHome
from ground.missions.qgroundcontrol import to_global
from protocol.wire.enums import GoalState, MissionState, Mode, Vehicle
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from robot.commands import NOTES
from tests.support.each import each
from tests.support.gateway.fake_port import (
    CLIENT,
    ORIGIN,
    OTHER,
    PLACE,
    Bench,
    accept_all,
    acks,
    command,
    command_int,
    driving_bench,
    local_target,
    numbered,
    odometry,
    performed,
    show,
    status,
    words,
)

ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
SET_MODE = mavlink.MAV_CMD_DO_SET_MODE
ACCEPTED = 0
LATER = 1
DENIED = 2
UNSUPPORTED = 3
FAILED = 4


@pytest.fixture
def bench() -> Bench:
    return new_bench()


def new_bench() -> Bench:
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
    bench.receive(command(ARM, 1), OTHER)
    bench.port.answer()
    sends = bench.vehicle.outbox.take()
    assert [(one.client, one.message.target_system) for one in sends] == [(2, 254)]
    assert sends[0].message.target_component == OTHER.component


def test_ack_waits_for_the_robot(bench: Bench) -> None:
    assert acks(bench.send(command(ARM, 1))) == []
    bench.port.answer()
    assert acks(bench.sent()) == [(ARM, ACCEPTED)]


class LossyClient:
    """Repeats a command each 0.5 s until it gets an acknowledgement of its number.

    A fifth of the frames is lost in each direction, and a tenth of its own arrives twice.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench, self._random = bench, Random(1)
        self._inbox: deque[tuple[int, int]] = deque()
        bench.vehicle.lossy = {CLIENT.client}

    def result_of(self, number: int, *params: float) -> int:
        """Return the result that the client takes for that of its command."""
        for confirmation in range(100):
            message = command(number, *params, confirmation=confirmation)
            if self._random.random() >= 0.2:
                for _ in range(1 + (self._random.random() < 0.1)):
                    self._bench.receive(message)
                    accept_all(self._bench)
            sent = acks(self._bench.sent())
            self._inbox.extend(one for one in sent if self._random.random() >= 0.2)
            while self._inbox:
                acknowledged, result = self._inbox.popleft()
                if acknowledged == number:
                    return result
            self._bench.now_ns += 480_000_000
            self._bench.after(0.02)
        raise AssertionError("no answer")


def test_answer_belongs_to_its_command_on_a_lossy_line() -> None:
    bench = driving_bench()
    client = LossyClient(bench)
    pairs = (
        ((SET_MODE, 1, 77), (SET_MODE, 1, Mode.HOLD)),
        ((ARM, 7), (ARM, 1)),
        ((ARM, 0), (ARM, 7)),
    )
    wanted = ((DENIED, ACCEPTED), (DENIED, ACCEPTED), (ACCEPTED, DENIED))
    for at in range(1000):
        first, second = pairs[at % 3]
        assert (client.result_of(*first), client.result_of(*second)) == wanted[at % 3], at


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


def test_copy_of_a_frame_acts_once_and_is_answered_once(bench: Bench) -> None:
    message = command(ARM, 1)
    bench.send(message)
    bench.port.answer()
    bench.sent()
    assert acks(bench.send(message)) == []
    assert bench.port.performed == [Arm()]
    bench.now_ns += 500_000_000
    assert acks(bench.send(message)) == [(ARM, ACCEPTED)], "its client never counts its frames"
    assert bench.port.performed == [Arm()]


def test_copy_of_a_request_or_a_refused_command_has_no_answer(bench: Bench) -> None:
    for message in (command(3000), command(512, 1e5), command(SET_MODE, 1, 77)):
        assert len(acks(bench.send(message))) == 1
        assert acks(bench.send(message)) == []


def test_copy_of_a_stop_stops_but_has_no_answer(bench: Bench) -> None:
    message = command(SET_MODE, 1, Mode.HOLD)
    for _ in range(2):
        bench.send(message)
    accept_all(bench)
    assert bench.port.performed == [Hold()] * 2
    assert acks(bench.sent()) == [(SET_MODE, ACCEPTED)]


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


@each("value", [nan, inf, -inf, 65535.0, 0.5, -1.0])
@each("number", [176, 178, 185, 193, 194, 300, 400])
def test_hostile_parameters_are_answered(number: int, value: float) -> None:
    bench = new_bench()
    sent = bench.send(command(number, *[value] * 7))
    assert acks(sent) or bench.port.performed or bench.port.stops


def test_every_reason_has_a_result() -> None:
    assert set(RESULTS) == set(Reason)
    accepted = {reason for reason, result in RESULTS.items() if result == ACCEPTED}
    assert accepted == {Reason.NONE, *NOTES}


def test_refusal_names_its_reason(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH))
    bench.port.answer(Refused(Reason.NO_TRAIL, 1))
    sent = bench.sent()
    assert acks(sent) == [(20, FAILED)]
    assert "no trail" in words(sent)


NOT_IN_CONTROL = 10
ARM_COMMAND, SET_MODE_COMMAND, PAUSE, STOP, SPEED, HOME = 400, 176, 193, 185, 178, 179
HERE = (47.37691, 8.54172)
MAKES: dict[str, tuple[float, ...]] = {
    "arm": (ARM_COMMAND, 1),
    "MANUAL": (SET_MODE_COMMAND, 1, Mode.MANUAL),
    "AUTO": (SET_MODE_COMMAND, 1, Mode.AUTO),
    "GUIDED": (SET_MODE_COMMAND, 1, Mode.GUIDED),
    "RTL": (20,),
    "mission": (300,),
    "resume": (PAUSE, 1),
    "goto": (192, -1, 1, 0, 0, *HERE),
}
"""Commands of the client in control that make a state."""
ENDS: dict[str, Callable[[Bench], object]] = {
    "hold": lambda bench: bench.send(command(SET_MODE_COMMAND, 1, Mode.HOLD), OTHER),
    "pause": lambda bench: bench.send(command(PAUSE, 0), OTHER),
    "disarm": lambda bench: bench.send(command(ARM_COMMAND, 0), OTHER),
    "emergency stop": lambda bench: bench.send(command(STOP, 1), OTHER),
    "hold of the app": lambda bench: show(bench, Mode.HOLD),
    "disarmed by the app": lambda bench: show(bench, Mode.GUIDED, vehicle=Vehicle.STANDBY),
    "emergency stop of the app": lambda bench: stopped(bench),
}
"""How somebody else ends it."""


def stopped(bench: Bench) -> None:
    bench.port.telemetry["status"] = status(vehicle=Vehicle.EMERGENCY_STOP, stop_id=9)
    bench.after(0.02)


def made(name: str, confirmation: int = 0) -> MavMessage:
    number, *params = MAKES[name]
    return command(int(number), *params, confirmation=confirmation)


def bench_after(name: str) -> Bench:
    """Return a bench whose client has got its command accepted."""
    bench = driving_bench(Mode.SMART_RTL)
    show(bench, Mode.SMART_RTL, MissionState.READY)
    bench.send(made(name))
    accept_all(bench)
    show(bench, Mode.SMART_RTL if name in ("arm", "resume") else Mode.GUIDED, MissionState.READY)
    bench.after(0.4)
    assert performed(bench)
    bench.sent()
    return bench


@each("name", list(MAKES))
@each("end", list(ENDS))
def test_command_acts_again_after_somebody_has_ended_its_effect(name: str, end: str) -> None:
    bench = bench_after(name)
    ENDS[end](bench)
    accept_all(bench)
    bench.sent()
    performed(bench)
    sent = bench.send(made(name))
    if name == "GUIDED" and bench.vehicle.modes.number == Mode.GUIDED:
        assert [result for _, result in acks(sent)] == [ACCEPTED], "a stop does not end this mode"
        return
    assert performed(bench), "asked anew"
    bench.port.refuse(Reason.EMERGENCY_STOPPED)
    ((_, result),) = acks(bench.sent())
    assert result != ACCEPTED


@each("name", list(MAKES))
@each("end", list(ENDS))
def test_repetition_of_a_lost_frame_undoes_no_stop(name: str, end: str) -> None:
    """Its sender has not decided anew: perhaps the answer was lost before the stop."""
    bench = bench_after(name)
    ENDS[end](bench)
    accept_all(bench)
    bench.sent()
    performed(bench)
    sent = bench.send(made(name, confirmation=1))
    assert [result for _, result in acks(sent)] == [LATER]
    assert "the robot was stopped since" in words(sent)
    assert performed(bench) == []


@each("name", list(MAKES))
@each("confirmation", [0, 1])
def test_command_acts_once_while_its_effect_lasts(name: str, confirmation: int) -> None:
    bench = bench_after(name)
    bench.send(command(STOP, 0), OTHER)  # is refused: not in control
    bench.send(command(ARM_COMMAND, 1), OTHER)
    bench.sent()
    sent = bench.send(made(name, confirmation))
    assert [result for _, result in acks(sent)] == [ACCEPTED]
    assert performed(bench) == []


@each("end", list(ENDS))
def test_copy_of_a_frame_by_the_network_does_nothing_after_a_stop(end: str) -> None:
    bench = driving_bench()
    message = made("goto")
    bench.send(message)
    accept_all(bench)
    show(bench, Mode.GUIDED)
    ENDS[end](bench)
    accept_all(bench)
    bench.sent()
    performed(bench)
    assert acks(bench.send(message)) == []
    assert performed(bench) == []


def test_goal_that_another_request_has_replaced_is_set_again() -> None:
    bench = bench_after("goto")
    bench.send(local_target(mask=PLACE, x=1.0, y=2.0))
    accept_all(bench)
    performed(bench)
    bench.send(made("goto"))
    assert len(performed(bench)) == 1


def test_goal_that_was_given_up_is_set_again() -> None:
    bench = bench_after("goto")
    ended = status(vehicle=Vehicle.ACTIVE, mode=Mode.GUIDED, goal=GoalState.STUCK, goal_id=3)
    bench.port.telemetry["status"] = ended
    bench.after(0.02)
    bench.send(made("goto"))
    assert len(performed(bench)) == 1


@each("seizer", [OTHER, None])
def test_client_that_has_lost_control_is_not_told_accepted(seizer: Sender | None) -> None:
    bench = driving_bench(Mode.GUIDED)
    bench.send(command(32100, 1, 1, 10))
    bench.send(command(ARM_COMMAND, 1))
    accept_all(bench)
    bench.sent()
    if seizer is None:
        bench.port.holder = "ada"
        bench.port.telemetry["lease"] = LeaseStatus(
            time_ns=0, lapses_ms=900, held=1, holder="ada/7", name="ada"
        )
        bench.after(0.4)
    else:
        bench.send(command(32100, 1, 0, 10), seizer)
    sent = bench.send(command(ARM_COMMAND, 1))
    assert acks(sent) == [(ARM_COMMAND, NOT_IN_CONTROL)]
    assert performed(bench) == [Arm()]


def test_refused_command_is_asked_anew() -> None:
    """What was in the way may be gone."""
    bench, found = driving_bench(vehicle=Vehicle.STANDBY), list[tuple[int, int]]()
    for reason in (Reason.NO_SENSES, Reason.FENCE_UNREADABLE):
        bench.send(command(ARM_COMMAND, 1))
        bench.port.refuse(reason)
        found += acks(bench.sent())
    bench.send(command(ARM_COMMAND, 1))
    bench.port.answer()
    assert [*found, *acks(bench.sent())] == [
        (ARM_COMMAND, LATER),
        (ARM_COMMAND, FAILED),
        (ARM_COMMAND, ACCEPTED),
    ]


@each(("number", "result"), [(HOME, ACCEPTED), (SPEED, LATER)])
def test_value_outlasts_a_stop_but_no_speed_does(number: int, result: int) -> None:
    bench = driving_bench(Mode.GUIDED)
    params = (1, 0.5, -1)
    bench.send(command(number, *params))
    accept_all(bench)
    bench.send(command(SET_MODE_COMMAND, 1, Mode.HOLD), OTHER)
    accept_all(bench)
    performed(bench)
    bench.sent()
    assert acks(bench.send(command(number, *params, confirmation=1))) == [(number, result)]
    assert performed(bench) == []


@each("sender", [CLIENT, OTHER])
@each("message", [(SET_MODE_COMMAND, 1, Mode.HOLD), (PAUSE, 0), (ARM_COMMAND, 0)])
def test_stop_needs_no_control_and_no_lease(sender: Sender, message: tuple[float, ...]) -> None:
    bench = driving_bench(Mode.GUIDED)
    bench.port.holder = "ada"
    number, *params = message
    for _ in range(2):
        bench.send(command(int(number), *params), sender)
        bench.port.answer()
        assert acks(bench.sent()) == [(number, ACCEPTED)]
    assert bench.port.leases == []


def test_stream_of_the_owner_does_not_undo_the_hold_of_another() -> None:
    bench = driving_bench(Mode.GUIDED)
    bench.send(local_target(frame=8, vx=0.5))
    accept_all(bench)
    show(bench, Mode.MANUAL)
    performed(bench)
    bench.send(command(SET_MODE_COMMAND, 1, Mode.HOLD), OTHER)
    bench.send(local_target(frame=8, vx=0.5))
    bench.send(local_target(mask=PLACE, x=1.0, y=2.0))
    assert performed(bench) == [Hold()]
    bench.port.answer()
    bench.send(local_target(frame=8, vx=0.5))
    show(bench, Mode.HOLD)
    bench.after(1.5)
    assert performed(bench) == []
    assert bench.vehicle.modes.number == Mode.HOLD


UNSUPPORTED_FRAME = 9
SET_HOME, GET_HOME, BANNER, RESTART = 179, 410, 42428, 246
LATITUDE_DEG, LONGITUDE_DEG = to_global(ORIGIN, 12.0, -7.0)
X, Y = round(LATITUDE_DEG * PER_DEG), round(LONGITUDE_DEG * PER_DEG)


@pytest.fixture
def upkeep_bench() -> Bench:
    return driving_bench()


def homes(messages: list[MavMessage]) -> list[tuple[float, float]]:
    """Return the north and east of each HOME_POSITION."""
    return [(m.x, m.y) for m in messages if m.get_type() == "HOME_POSITION"]


def test_banner_names_version_and_robot(upkeep_bench: Bench) -> None:
    sent = upkeep_bench.send(command(BANNER))
    assert acks(sent) == [(BANNER, ACCEPTED)]
    assert words(sent).startswith("ArduRover V4.")
    assert "robot r1" in words(sent)


def test_home_is_sent_on_request(upkeep_bench: Bench) -> None:
    sent = upkeep_bench.send(command(GET_HOME))
    assert acks(sent) == [(GET_HOME, ACCEPTED)]
    assert homes(sent) == [(0.0, 0.0)]


def test_home_at_a_place(upkeep_bench: Bench) -> None:
    sent = upkeep_bench.send(command_int(SET_HOME, 0, x=X, y=Y))
    assert acks(sent) == [(SET_HOME, ACCEPTED)]
    assert homes(sent)[0] == pytest.approx((-7.0, 12.0), abs=0.02)
    assert homes(upkeep_bench.send(command(GET_HOME)))[0] == pytest.approx((-7.0, 12.0), abs=0.02)


def test_home_where_the_robot_is(upkeep_bench: Bench) -> None:
    assert homes(upkeep_bench.send(command(SET_HOME, 1))) == [(4.0, 3.0)]


def test_home_where_an_unplaced_robot_is_is_denied(upkeep_bench: Bench) -> None:
    upkeep_bench.port.telemetry["odometry"] = odometry(cov_xx_m2=nan)
    upkeep_bench.after(0.02)
    assert acks(upkeep_bench.send(command(SET_HOME, 1))) == [(SET_HOME, DENIED)]


@pytest.mark.parametrize("value", [0.0, nan, inf, 1e30, -90.0])
def test_home_at_no_place_is_denied(upkeep_bench: Bench, value: float) -> None:
    sent = upkeep_bench.send(command(SET_HOME, 0, 0, 0, 0, value, value, 0))
    assert acks(sent) == [(SET_HOME, DENIED)]
    assert homes(upkeep_bench.send(command(GET_HOME))) == [(0.0, 0.0)]


def test_home_in_a_local_frame_is_refused(upkeep_bench: Bench) -> None:
    sent = upkeep_bench.send(command_int(SET_HOME, 0, x=X, y=Y, frame=1))
    assert acks(sent) == [(SET_HOME, UNSUPPORTED_FRAME)]


def test_home_of_another_client_is_refused(upkeep_bench: Bench) -> None:
    upkeep_bench.take_control(CLIENT)
    sent = upkeep_bench.send(command_int(SET_HOME, 0, x=X, y=Y), OTHER)
    assert acks(sent) == [(SET_HOME, NOT_IN_CONTROL)]


def test_rtl_drives_to_a_chosen_home(upkeep_bench: Bench) -> None:
    upkeep_bench.send(command(SET_HOME, 1))
    upkeep_bench.send(command(176, 1, 11))
    home = Destination(x_m=3.0, y_m=4.0, heading_rad=None)
    assert performed(upkeep_bench) == [Goto(goal=home, wait=False, arms=False)]
    upkeep_bench.port.answer()
    show(upkeep_bench, Mode.AUTO)
    assert upkeep_bench.vehicle.modes.number == 11
    upkeep_bench.send(command(176, 1, 12))
    assert performed(upkeep_bench) == [ReturnHome()]


def test_restart_of_a_disarmed_robot() -> None:
    bench = driving_bench(vehicle=Vehicle.STANDBY)
    bench.send(command(RESTART, 1))
    assert performed(bench) == [Restart()]
    bench.port.answer()
    assert acks(bench.sent()) == [(RESTART, ACCEPTED)]


def test_restart_of_an_armed_robot_is_denied(upkeep_bench: Bench) -> None:
    sent = upkeep_bench.send(command(RESTART, 1))
    assert acks(sent) == [(RESTART, DENIED)]
    assert "disarm first" in words(sent)
    assert performed(upkeep_bench) == []


def test_restart_that_the_robot_refuses_is_denied() -> None:
    bench = driving_bench(vehicle=Vehicle.STANDBY)
    bench.send(command(RESTART, 1))
    bench.port.refuse(Reason.ARMED)
    assert acks(bench.sent()) == [(RESTART, DENIED)]


@each("action", [0.0, 2.0, 3.0, nan, inf, 65535.0])
def test_other_actions_than_a_restart_are_denied(action: float) -> None:
    bench = driving_bench(vehicle=Vehicle.STANDBY)
    assert acks(bench.send(command(RESTART, action))) == [(RESTART, DENIED)]
    assert performed(bench) == []


def test_restart_of_a_silent_robot_is_rejected() -> None:
    bench = driving_bench()
    bench.port.telemetry.clear()
    bench.after(0.02)
    assert acks(bench.send(command(RESTART, 1))) == [(RESTART, LATER)]
