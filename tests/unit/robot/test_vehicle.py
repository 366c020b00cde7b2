"""The vehicle: commands, modes and reports, and a pose that only an operator sets."""

import json
from math import inf, isnan, nan, pi
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from protocol.wire.enums import AckResult, Command, GoalState, Mode, Navigator, Severity, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    ParamRequestRead,
    ParamSet,
    ParamValue,
)
from protocol.wire.reasons import Reason, reason_text
from protocol.wire.statustext import StatustextAssembler
from robot import telemetry
from robot.commands import TABLE
from robot.core import brain, states
from robot.core.parameters import DEFAULTS
from robot.core.values import Pose
from robot.storage import Store
from robot.vehicle import RobotVehicle
from runtime.units import NS_PER_MS as MS
from tests.support.each import each
from tests.support.robots import Desk, armed, goal, ready, start


def restarted() -> Desk:
    """Return a robot whose wheels had turned before its process started, after one tick."""
    desk = Desk()
    desk.left = desk.right = 5000.0
    desk.step()
    return desk


def texts(desk: Desk) -> list[tuple[int, str]]:
    assembler = StatustextAssembler()
    whole = [(text.severity, assembler.receive(text)) for text in desk.vehicle.texts()]
    return [(severity, words) for severity, words in whole if words]


def set_pose(desk: Desk, x_m: float, y_m: float, heading_rad: float) -> int:
    return desk.command(Command.SIDESTEP_SET_POSE, x_m, y_m, heading_rad)


def from_robot(request: GoalRequest) -> GoalRequest:
    return structs.replace(request, from_robot=1)


def test_restarted_robot_says_that_its_place_is_unknown_once() -> None:
    desk = restarted()
    words = f"PLACE UNKNOWN: {reason_text(Reason.PLACE_UNKNOWN)}"
    assert (Severity.ERROR, words) in texts(desk)
    desk.step()
    assert texts(desk) == []


def test_robot_at_its_start_reports_no_unknown_place() -> None:
    desk = Desk()
    desk.step()
    assert not [words for _, words in texts(desk) if "PLACE" in words]


def test_covariance_without_a_place_is_not_a_number() -> None:
    desk = restarted()
    odometry = telemetry.odometry(desk.vehicle.state, 0)
    spread = [getattr(odometry, name) for name in odometry.__struct_fields__ if "cov" in name]
    assert len(spread) == 6
    assert all(isnan(value) for value in spread)
    assert (odometry.x_m, odometry.y_m, odometry.heading_rad) == (0.0, 0.0, 0.0)
    assert set_pose(desk, 1.0, 2.0, 0.5) == Reason.NONE
    odometry = telemetry.odometry(desk.vehicle.state, 0)
    assert 0.0 < odometry.cov_xx_m2 < 1e-6
    assert (odometry.x_m, odometry.y_m) == (1.0, 2.0)


def test_goal_is_refused_until_the_place_is_set() -> None:
    desk = restarted()
    assert desk.arm() == Reason.NONE
    assert desk.goto(2, 0) == Reason.PLACE_UNKNOWN
    assert desk.command(Command.NAV_RETURN_TO_LAUNCH) == Reason.PLACE_UNKNOWN
    assert set_pose(desk, 0.5, 0.0, 0.0) == Reason.NONE
    assert desk.goto(2, 0) == Reason.NONE


def test_goal_relative_to_the_robot_is_accepted_without_a_place() -> None:
    desk = restarted()
    desk.arm()
    answer = desk.vehicle.receive(from_robot(goal(99, 1.0, 0.0)), desk.now_ns)
    assert isinstance(answer, CommandAck)
    assert answer.result_param2 == Reason.NONE


def test_set_pose_is_announced_and_acknowledged_as_itself() -> None:
    desk = restarted()
    texts(desk)
    assert set_pose(desk, 1.25, -2.5, pi / 2) == Reason.NONE
    assert (Severity.NOTICE, "place set: 1.25 -2.50 m, 90 deg") in texts(desk)
    assert set_pose(desk, nan, 0.0, 0.0) == Reason.PARAMETER_OUT_OF_RANGE
    assert texts(desk) == []


def test_heading_that_is_not_given_stays() -> None:
    desk = Desk()
    desk.step()
    assert set_pose(desk, 1.0, 1.0, 0.75) == Reason.NONE
    assert set_pose(desk, 2.0, 1.0, nan) == Reason.NONE
    x_m, y_m, heading_rad = desk.vehicle.state.odometry.pose
    assert (x_m, y_m) == (2.0, 1.0)
    assert heading_rad == pytest.approx(0.75)


def test_restarted_plant_makes_the_place_unknown() -> None:
    desk = armed()
    desk.goto(2, 0)
    desk.vehicle.lose_position(desk.now_ns)
    assert desk.vehicle.state.machine.vehicle_reason == Reason.TICKS_LOST
    desk.step()
    assert desk.arm() == Reason.NONE
    assert desk.goto(2, 0) == Reason.PLACE_UNKNOWN
    assert [words for _, words in texts(desk) if words.startswith("PLACE UNKNOWN")]


def test_totals_of_the_start_are_given_with_it() -> None:
    vehicle = RobotVehicle(DEFAULTS, Store(None), Pose(1.0, 2.0, 0.0), totals=(5000, 5000))
    desk = Desk()
    desk.vehicle = vehicle
    desk.left = desk.right = 5000.0
    desk.step()
    assert vehicle.state.machine.placed
    assert vehicle.state.odometry.pose == Pose(1.0, 2.0, 0.0)


def test_it_starts_disarmed_with_a_text() -> None:
    desk = Desk()
    desk.step()
    assert desk.vehicle.state.machine.vehicle == Vehicle.STANDBY
    assert "started: disarmed, standing still" in [t.text for t in desk.vehicle.texts()]


def test_a_goal_before_arming_is_refused_with_the_reason() -> None:
    desk = Desk()
    desk.step()
    assert desk.goto(2, 0) == Reason.NOT_ARMED


def test_an_armed_robot_takes_a_goal_and_drives() -> None:
    desk = Desk()
    assert desk.arm() == Reason.NONE
    assert desk.goto(2, 0) == Reason.NONE
    outputs = [desk.step() for _ in range(3)][-1]
    assert outputs.left_mrad_s > 0
    assert outputs.right_mrad_s > 0


def test_repeated_request_is_answered_but_not_acted_on() -> None:
    desk = armed()
    request = goal(77, 2, 0)
    first = desk.vehicle.receive(request, desk.now_ns)
    serial = desk.vehicle.state.machine.serial
    desk.command(Command.SIDESTEP_ABORT_GOAL)
    assert desk.vehicle.receive(request, desk.now_ns) == first
    assert desk.vehicle.state.machine.serial == serial
    assert desk.vehicle.state.machine.goal_state == GoalState.ABORTED


UNUSED = {
    Command.COMPONENT_ARM_DISARM: (1, nan),
    Command.DO_SET_MODE: (nan, Mode.AUTO),
    Command.DO_PAUSE_CONTINUE: (0, nan),
    Command.DO_FLIGHTTERMINATION: (nan, nan),
    Command.NAV_RETURN_TO_LAUNCH: (nan, nan),
    Command.MISSION_START: (0, nan),
    Command.DO_SET_MISSION_CURRENT: (0, nan),
    Command.PREFLIGHT_REBOOT_SHUTDOWN: (1, nan),
    Command.DO_CHANGE_SPEED: (0, 0.2),
    Command.SIDESTEP_SET_NAVIGATOR: (Navigator.BUG, 1),
    Command.SIDESTEP_SET_POSE: (1, 2),
    Command.SIDESTEP_ABORT_GOAL: (nan, nan),
    Command.SIDESTEP_CLEAR_EMERGENCY_STOP: (nan, nan),
}
"""Each command with NaN, which MAVLink uses for unused fields, in each unused field."""


def test_every_command_lists_the_fields_it_uses() -> None:
    assert UNUSED.keys() == TABLE.keys()


def underway() -> Desk:
    desk = ready(2)
    assert start(desk) == Reason.NONE
    desk.step()
    return desk


DONE = (Reason.NONE, Reason.NOTHING_LATCHED, Reason.NOTHING_CHANGED)
STANDING = (Command.SIDESTEP_SET_POSE, Command.PREFLIGHT_REBOOT_SHUTDOWN)
"""Commands that a robot refuses during a mission."""


@each("value", [nan, inf, -inf])
@each("command", [one for one in UNUSED if one not in STANDING])
def test_a_field_that_a_command_does_not_use_may_hold_anything(
    command: Command, value: float
) -> None:
    fields = [value if isnan(used) else used for used in UNUSED[command]]
    assert underway().command(command, *fields) in DONE


@each("value", [nan, inf, -inf])
@each("command", UNUSED)
def test_a_command_with_a_value_that_is_no_number_is_refused(
    command: Command, value: float
) -> None:
    for at, used in enumerate(UNUSED[command]):
        if not isnan(used):
            fields = list(UNUSED[command])
            fields[at] = value
            assert underway().command(command, *fields) == Reason.PARAMETER_OUT_OF_RANGE


def test_an_emergency_stop_with_unused_fields_of_mavlink_stops() -> None:
    desk = underway()
    desk.command(Command.DO_FLIGHTTERMINATION, nan, nan)
    assert desk.vehicle.state.machine.vehicle == Vehicle.EMERGENCY_STOP
    assert (desk.step().left_mrad_s, desk.step().right_mrad_s) == (0, 0)


def test_an_unknown_command_is_unsupported() -> None:
    request = CommandRequest(request_id=1, command=31_000, param1=0, param2=0)
    answer = Desk().vehicle.receive(request, 0)
    assert isinstance(answer, CommandAck)
    assert answer.result == AckResult.UNSUPPORTED
    assert answer.result_param2 == Reason.UNKNOWN_COMMAND


@given(st.integers(0, 2**16 - 1), st.floats(width=32), st.floats(width=32))
def test_no_command_values_raise_an_exception(command: int, param1: float, param2: float) -> None:
    desk = armed()
    desk.command(command, param1, param2)
    desk.step()


def test_a_goal_farther_than_the_robot_accepts_is_refused() -> None:
    desk = armed()
    assert desk.goto(101, 0) == Reason.GOAL_OUT_OF_RANGE


def test_guided_needs_an_operator_and_stops_without_one() -> None:
    desk = armed()
    assert desk.goto(2, 0, Mode.GUIDED) == Reason.NO_OPERATOR
    desk.operator = True
    desk.step()
    assert desk.goto(2, 0, Mode.GUIDED) == Reason.NONE
    desk.operator = False
    ticks = 0
    while desk.vehicle.state.machine.vehicle == Vehicle.ACTIVE:
        desk.step()
        ticks += 1
        assert ticks < 60
    assert ticks * 0.05 == pytest.approx(1.5, abs=0.11)
    assert desk.vehicle.state.machine.vehicle_reason == Reason.OPERATOR_LOST
    assert desk.step().left_mrad_s == 0


def test_exception_in_the_core_stops_and_is_raised(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    desk = armed()
    desk.goto(2, 0)

    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(brain, "step", broken)
    with pytest.raises(ZeroDivisionError):
        desk.step()
    machine = desk.vehicle.state.machine
    assert machine.vehicle == Vehicle.FAILSAFE
    assert machine.vehicle_reason == Reason.CORE_EXCEPTION
    assert (machine.goal_state, machine.goal_reason) == (
        GoalState.ABORTED,
        Reason.CORE_EXCEPTION,
    )


def test_a_violated_budget_stops_the_wheels_with_its_reason() -> None:
    desk = armed()
    desk.goto(2, 0)
    desk.step()
    desk.vehicle.core.report(Reason.BUDGET)
    outputs = desk.step()
    assert (outputs.left_mrad_s, outputs.right_mrad_s) == (0, 0)
    assert desk.vehicle.state.machine.vehicle_reason == Reason.BUDGET


def test_every_change_is_announced_once() -> None:
    desk = armed()
    desk.goto(2, 0)
    desk.step()
    told = [text.text for text in desk.vehicle.texts()]
    assert "goal ACCEPTED" in told or "vehicle ACTIVE" in told
    desk.command(Command.DO_FLIGHTTERMINATION, 1)
    shouted = [(text.severity, text.text) for text in desk.vehicle.texts()]
    assert (Severity.CRITICAL, "vehicle EMERGENCY_STOP: by the operator") in shouted
    assert desk.vehicle.texts() == []


def test_a_long_reason_comes_in_numbered_pieces() -> None:
    desk = Desk()
    desk.vehicle.texts()
    desk.vehicle.announce(Severity.INFO, "x" * 120)
    pieces = desk.vehicle.texts()
    assert [len(piece.text) for piece in pieces] == [50, 50, 20]
    assert [piece.chunk_seq for piece in pieces] == [0, 1, 2]
    assert len({piece.id for piece in pieces}) == 1
    assert pieces[0].id != 0


def test_only_the_newest_unread_texts_are_kept() -> None:
    desk = Desk()
    for number in range(250):
        desk.vehicle.announce(Severity.INFO, f"word {number}")
    texts = desk.vehicle.texts()
    assert len(texts) == 100
    assert texts[-1].text == "word 249"


def test_heartbeats_come_at_5_hz_and_at_once_on_a_change() -> None:
    desk = Desk()
    beats = []
    for _ in range(21):
        desk.step()
        beats.append(desk.vehicle.heartbeat(desk.now_ns) is not None)
    assert 5 <= sum(beats) <= 7
    while desk.vehicle.heartbeat(desk.now_ns):
        desk.step()
    desk.command(Command.COMPONENT_ARM_DISARM, 1)
    beat = desk.vehicle.heartbeat(desk.now_ns)
    assert beat is not None
    assert beat.base_mode & 128


def set_parameter(desk: Desk, name: str, value: float) -> Message:
    return desk.vehicle.receive(ParamSet(param_id=name, param_value=value, param_type=9), 0)


def test_a_parameter_is_set_answered_and_read_back() -> None:
    desk = Desk()
    answer = set_parameter(desk, "d_obs_m", 0.44999998807907104)
    assert isinstance(answer, ParamValue)
    assert desk.vehicle.params.d_obs_m == 0.45
    read = desk.vehicle.receive(ParamRequestRead(param_id="d_obs_m", param_index=-1), 0)
    assert read == answer
    again = desk.vehicle.receive(ParamRequestRead(param_id="", param_index=answer.param_index), 0)
    assert again == answer


@each(
    ("navigator", "parameter"),
    [(states.VGM, "d_obs_m"), (states.BUG, "d_th_m"), (states.DISTBUG, None)],
)
def test_the_zone_is_that_of_the_navigator_in_use(navigator: int, parameter: str | None) -> None:
    desk = Desk()
    set_parameter(desk, "navigator", navigator)
    assert isnan(desk.vehicle.zone_m) == (parameter is None)
    if parameter:
        set_parameter(desk, parameter, 0.45)
        assert desk.vehicle.zone_m == 0.45


def refused(answer: object) -> int:
    assert isinstance(answer, CommandAck)
    assert answer.result == AckResult.DENIED
    return answer.result_param2


@each("value", [nan, inf, 0.0, 1e9])
def test_an_impossible_value_is_refused_and_nothing_changes(value: float) -> None:
    desk = Desk()
    before = desk.vehicle.params
    assert refused(set_parameter(desk, "d_obs_m", value)) == Reason.PARAMETER_OUT_OF_RANGE
    assert desk.vehicle.params == before


def test_an_unknown_parameter_is_refused() -> None:
    desk = Desk()
    assert refused(set_parameter(desk, "d_obs", 1)) == Reason.UNKNOWN_PARAMETER
    request = ParamRequestRead(param_id="d_obs", param_index=-1)
    assert refused(desk.vehicle.receive(request, 0)) == Reason.UNKNOWN_PARAMETER


def test_the_navigator_is_a_parameter_that_changes_under_way_too() -> None:
    desk = armed()
    desk.goto(2, 0)
    assert DEFAULTS.navigator != Navigator.BUG
    set_parameter(desk, "navigator", Navigator.BUG)
    assert desk.vehicle.params.navigator == Navigator.BUG
    assert desk.vehicle.state.machine.navigator == Navigator.BUG


def test_navigator_command_changes_the_parameters_too() -> None:
    desk = Desk()
    assert b'"value": 6' in described(desk, "navigator")
    assert desk.command(Command.SIDESTEP_SET_NAVIGATOR, Navigator.BUG, -1) == Reason.NONE
    assert (desk.vehicle.params.navigator, desk.vehicle.params.side) == (Navigator.BUG, -1)
    assert b'"value": 1' in described(desk, "navigator")
    assert b'"value": -1' in described(desk, "side")
    before = desk.vehicle.params
    assert desk.command(Command.SIDESTEP_SET_NAVIGATOR, 99, 1) == Reason.UNKNOWN_NAVIGATOR
    assert desk.vehicle.params is before


def test_parameter_after_a_navigator_command_keeps_its_choice() -> None:
    desk = Desk()
    desk.command(Command.SIDESTEP_SET_NAVIGATOR, Navigator.BUG, -1)
    set_parameter(desk, "d_obs_m", 0.4)
    machine = desk.vehicle.state.machine
    assert (machine.navigator, machine.side) == (Navigator.BUG, states.RIGHT)


def described(desk: Desk, name: str) -> bytes:
    """Return a parameter's row in the list that the robot publishes."""
    text = desk.vehicle.parameters.describe()
    return text[text.index(b'"name": "%s"' % name.encode()) :].partition(b"}")[0]


def test_value_that_cannot_be_saved_is_in_force_and_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    desk = Desk(Store(tmp_path))
    desk.vehicle.texts()
    assert refused(set_parameter(desk, "d_obs_m", 0.5)) == Reason.NOT_SAVED
    assert desk.vehicle.params.d_obs_m == 0.5
    assert "No space left" in desk.vehicle.texts()[0].text


@pytest.mark.parametrize("keeps", [True, False])
def test_list_shows_which_values_survive_a_restart(tmp_path: Path, keeps: bool) -> None:
    desk = Desk(Store(tmp_path if keeps else None))
    set_parameter(desk, "d_obs_m", 0.45)
    rows = json.loads(desk.vehicle.parameters.describe())
    assert [row["name"] for row in rows if row["saved"]] == (["d_obs_m"] if keeps else [])


def test_the_end_of_the_process_ends_the_goal() -> None:
    desk = armed()
    desk.goto(2, 0)
    desk.vehicle.stop(Reason.SHUT_DOWN, desk.now_ns)
    machine = desk.vehicle.state.machine
    assert (machine.goal_state, machine.goal_reason) == (GoalState.ABORTED, Reason.SHUT_DOWN)


def test_operator_without_heartbeats_has_no_age() -> None:
    desk = Desk()
    assert desk.vehicle.operator_age_ms(5 * MS) is None
    desk.vehicle.lease.beat("", 5 * MS)
    assert desk.vehicle.operator_age_ms(9 * MS) == 4


def test_suspected_slip_is_announced_once() -> None:
    desk = Desk()
    desk.step()
    desk.vehicle.texts()
    desk.vehicle.state.slip.share = 0.4
    desk.step()
    desk.step()
    told = [text.text for text in desk.vehicle.texts()]
    assert told == ["wheel slip suspected: position less certain"]
