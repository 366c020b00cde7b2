"""Arming, modes and driving by command, and by hand."""

from math import nan
from typing import Any

import pytest

from gateways.mavlink.mav_service import WATCHER
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.motion.pilot import EnterGuided, LimitDrive
from gateways.mavlink.services import face_of
from ground.client.outcomes import Operation
from ground.commands.arm import Arm
from ground.commands.disarm import Disarm
from ground.commands.hold import Hold
from ground.commands.mission import StartMission
from ground.commands.mode import SetMode
from ground.commands.resume import Resume
from ground.commands.rtl import ReturnHome
from ground.commands.stop import ClearEmergencyStop
from protocol.wire.enums import LeaseAction, MissionState, Mode, Vehicle
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.gateway.fake_port import (
    CLIENT,
    LIMITS,
    OTHER,
    Bench,
    acks,
    command,
    driving_bench,
    everything,
    local_target,
    manual_control,
    performed,
    rc_override,
    status,
    words,
)
from tests.support.gateway.fake_port import show as piloting_show

ACCEPTED = 0
LATER = 1
DENIED = 2
UNSUPPORTED = 3
FAILED = 4
FROM_CURRENT = StartMission(item=0, arms=False)


@pytest.fixture
def bench() -> Bench:
    return driving_bench()


def set_mode(bench: Bench, mode: int) -> list[tuple[int, int]]:
    """Choose a mode; the robot accepts."""
    sent = bench.send(command(mavlink.MAV_CMD_DO_SET_MODE, 1, mode))
    if bench.port.waiting:
        bench.port.answer()
    return acks(sent + bench.sent())


def shown(bench: Bench) -> list[int]:
    """Return the modes in the heartbeats of a round."""
    return [m.custom_mode for m in bench.after(0.02) if m.get_type() == "HEARTBEAT"]


@each("mode", [1, 3, 5, 6, 7, 8, 9, 16, 65535, -1, 2**31])
def test_mode_that_is_missing_is_denied(mode: int) -> None:
    bench = driving_bench()
    sent = bench.send(command(mavlink.MAV_CMD_DO_SET_MODE, 1, mode))
    assert acks(sent) == [(176, DENIED)]
    assert "no mode" in words(sent)


@pytest.mark.parametrize(
    ("mode", "operation"),
    [
        (0, SetMode(mode=Mode.MANUAL)),
        (4, Hold()),
        (10, FROM_CURRENT),
        (11, ReturnHome()),
        (12, ReturnHome()),
        (15, EnterGuided()),
    ],
)
def test_each_mode_is_an_operation(bench: Bench, mode: int, operation: Operation[Any]) -> None:
    assert set_mode(bench, mode) == [(176, ACCEPTED)]
    assert performed(bench) == [operation]


def test_rtl_is_shown_as_asked(bench: Bench) -> None:
    set_mode(bench, 11)
    assert shown(bench) == [11]
    piloting_show(bench, Mode.SMART_RTL)
    bench.after(1.0)
    assert bench.vehicle.modes.number == 11
    set_mode(bench, 12)
    assert shown(bench) == [12]


def test_return_to_launch_is_shown_as_rtl(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH))
    bench.port.answer()
    assert bench.vehicle.modes.number == 11


def test_mode_that_another_operator_chose_is_shown(bench: Bench) -> None:
    set_mode(bench, 11)
    piloting_show(bench, Mode.SMART_RTL)
    piloting_show(bench, Mode.HOLD)
    piloting_show(bench, Mode.SMART_RTL)
    assert bench.vehicle.modes.number == 12


def test_refused_mode_is_not_shown(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_DO_SET_MODE, 1, 11))
    bench.port.refuse(Reason.NO_TRAIL)
    assert bench.vehicle.modes.number == Mode.HOLD


def test_accepted_mode_that_never_shows_is_dropped(bench: Bench) -> None:
    set_mode(bench, 0)
    assert bench.vehicle.modes.number == Mode.MANUAL
    bench.after(0.4)
    assert bench.vehicle.modes.number == Mode.HOLD


def test_auto_continues_a_paused_mission(bench: Bench) -> None:
    piloting_show(bench, Mode.HOLD, MissionState.PAUSED)
    set_mode(bench, 10)
    assert performed(bench) == [SetMode(mode=Mode.AUTO)]


def test_auto_starts_a_finished_mission_again(bench: Bench) -> None:
    piloting_show(bench, Mode.AUTO, MissionState.DONE)
    set_mode(bench, 10)
    assert performed(bench) == [StartMission(item=None, arms=False)]


def test_auto_after_manual_starts_at_the_current_item(bench: Bench) -> None:
    piloting_show(bench, Mode.AUTO, MissionState.RUNNING)
    set_mode(bench, 0)
    set_mode(bench, 10)
    assert performed(bench) == [SetMode(mode=Mode.MANUAL), FROM_CURRENT]


def test_auto_without_a_mission_fails(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_DO_SET_MODE, 1, 10))
    bench.port.refuse(Reason.NO_MISSION)
    sent = bench.sent()
    assert acks(sent) == [(176, FAILED)]
    assert "no mission" in words(sent)


def test_auto_before_arming_starts_once_armed(bench: Bench) -> None:
    piloting_show(bench, Mode.HOLD, MissionState.READY, Vehicle.STANDBY)
    assert set_mode(bench, 10) == [(176, ACCEPTED)]
    assert performed(bench) == [SetMode(mode=Mode.AUTO)]
    piloting_show(bench, Mode.AUTO, MissionState.READY, Vehicle.STANDBY)
    bench.send(command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1))
    bench.port.answer()
    piloting_show(bench, Mode.AUTO, MissionState.READY)
    assert performed(bench) == [Arm(), FROM_CURRENT]
    bench.port.refuse(Reason.PLACE_UNKNOWN)
    assert "mission not started" in words(bench.sent())


def test_mission_does_not_start_for_another_operator(bench: Bench) -> None:
    piloting_show(bench, Mode.HOLD, MissionState.READY, Vehicle.STANDBY)
    set_mode(bench, 10)
    performed(bench)
    bench.port.telemetry["lease"] = LeaseStatus(
        time_ns=0, lapses_ms=1000, held=1, holder="ground/7", name="ada"
    )
    bench.after(0.5)
    piloting_show(bench, Mode.AUTO, MissionState.READY)
    assert performed(bench) == []


def test_guided_again_keeps_the_goal(bench: Bench) -> None:
    set_mode(bench, 15)
    piloting_show(bench, Mode.GUIDED)
    performed(bench)
    assert set_mode(bench, 15) == [(176, ACCEPTED)]
    bench.now_ns += 5_000_000_000
    assert set_mode(bench, 15) == [(176, ACCEPTED)]
    assert performed(bench) == []


def test_guided_after_hold_drops_the_goal(bench: Bench) -> None:
    piloting_show(bench, Mode.GUIDED)
    set_mode(bench, 4)
    set_mode(bench, 15)
    assert performed(bench) == [Hold(), EnterGuided()]


def test_first_heartbeat_is_waited_for(bench: Bench) -> None:
    """Control is taken once for it, and not given back meanwhile."""
    bench.port.telemetry["lease"] = LeaseStatus(time_ns=0, lapses_ms=0, held=0, holder="", name="")
    sent = bench.send(command(mavlink.MAV_CMD_DO_SET_MODE, 1, 0))
    bench.port.refuse(Reason.NO_OPERATOR)
    assert acks(sent + bench.sent()) == []
    bench.after(0.02)
    bench.port.answer()
    assert acks(bench.sent()) == [(176, ACCEPTED)]
    assert performed(bench) == [SetMode(mode=Mode.MANUAL)] * 2
    assert bench.port.names == ["MAVLink 255"] * 2
    assert bench.port.leases == [(LeaseAction.TAKE, "MAVLink 255")]


def test_wait_for_the_heartbeat_ends(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_DO_SET_MODE, 1, 0))
    sent = []
    for _ in range(60):
        if bench.port.waiting:
            bench.port.refuse(Reason.NO_OPERATOR)
        sent += bench.sent() + bench.after(0.02)
    assert acks(sent) == [(176, LATER)]


@pytest.mark.parametrize("first", [0.0, nan])
def test_mission_start(bench: Bench, first: float) -> None:
    bench.send(command(mavlink.MAV_CMD_MISSION_START, first, 0))
    assert performed(bench) == [FROM_CURRENT]


@pytest.mark.parametrize(("first", "last"), [(1, 0), (0, 5), (65535, 65535)])
def test_mission_start_with_items_is_denied(bench: Bench, first: int, last: int) -> None:
    assert acks(bench.send(command(300, first, last))) == [(300, DENIED)]


def test_mission_start_of_an_unarmed_robot_fails(bench: Bench) -> None:
    piloting_show(bench, Mode.HOLD, MissionState.READY, Vehicle.STANDBY)
    bench.send(command(300))
    bench.port.refuse(Reason.NOT_ARMED)
    assert acks(bench.sent()) == [(300, FAILED)]


def test_pause_and_continue(bench: Bench) -> None:
    for value in (0, 1):
        bench.send(command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, value))
    assert performed(bench) == [Hold(), Resume()]


def test_change_speed_limits_the_drive_and_no_parameter(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 0.25))
    assert [(one.speed_m_s, one.for_goal) for one in performed(bench)] == [(0.25, False)]
    bench.port.answer()
    assert acks(bench.sent()) == [(178, ACCEPTED)]


def test_change_speed_without_a_drive_fails(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 0.25))
    bench.port.refuse(Reason.NO_GOAL)
    assert acks(bench.sent()) == [(178, FAILED)]


def test_change_speed_to_the_default(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, -2))
    assert performed(bench) == [LimitDrive(None)]


def test_change_speed_that_changes_nothing(bench: Bench) -> None:
    assert acks(bench.send(command(178, 1, -1))) == [(178, ACCEPTED)]
    assert performed(bench) == []


def test_change_speed_of_climbing_is_denied(bench: Bench) -> None:
    assert acks(bench.send(command(178, 2, 0.25))) == [(178, DENIED)]


def test_change_speed_out_of_range_is_denied(bench: Bench) -> None:
    bench.send(command(178, 1, 99))
    bench.port.refuse(Reason.PARAMETER_OUT_OF_RANGE)
    assert acks(bench.sent()) == [(178, DENIED)]


@pytest.mark.parametrize(("value", "result"), [(0, ACCEPTED), (1, DENIED)])
def test_set_reverse(bench: Bench, value: int, result: int) -> None:
    assert acks(bench.send(command(194, value))) == [(194, result)]


def test_refusals_name_no_verbs_of_the_command_line(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_MISSION_START))
    bench.port.refuse(Reason.NO_MISSION)
    assert words(bench.sent()) == "refused: there is no mission to act on"


ARM, CHECKS, STOP = 400, 401, 185
NOT_IN_CONTROL = 10


@pytest.fixture
def standby_bench() -> Bench:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    show(bench, Vehicle.STANDBY)
    return bench


def show(bench: Bench, vehicle: Vehicle, reason: Reason = Reason.NONE) -> None:
    shown = status(vehicle=vehicle, vehicle_reason=reason, stop_id=7)
    bench.port.telemetry |= everything() | {"status": shown}
    bench.after(0.02)


def test_refused_arming_is_a_prearm_text(standby_bench: Bench) -> None:
    standby_bench.send(command(ARM, 1))
    standby_bench.port.refuse(Reason.FENCE_UNREADABLE)
    sent = standby_bench.sent()
    assert acks(sent) == [(ARM, FAILED)]
    assert words(sent).startswith("PreArm: the saved fence cannot be read")


def test_arming_in_an_emergency_stop_names_the_way_out(standby_bench: Bench) -> None:
    show(standby_bench, Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR)
    standby_bench.send(command(ARM, 1))
    standby_bench.port.refuse(Reason.EMERGENCY_STOPPED)
    assert "command 185 with 0 clears it" in words(standby_bench.sent())


@pytest.mark.parametrize("force", [2989, 21196])
def test_forced_arming_clears_the_emergency_stop(standby_bench: Bench, force: int) -> None:
    show(standby_bench, Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR)
    standby_bench.send(command(ARM, 1, force))
    standby_bench.port.answer()
    standby_bench.port.answer()
    assert standby_bench.port.performed == [ClearEmergencyStop(stop_ids=(7,)), Arm()]
    assert acks(standby_bench.sent()) == [(ARM, ACCEPTED)]


def test_forced_arming_without_control_clears_nothing(standby_bench: Bench) -> None:
    show(standby_bench, Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR)
    standby_bench.port.holder = "ada"
    sent = standby_bench.send(command(ARM, 1, 21196))
    assert acks(sent) == [(ARM, NOT_IN_CONTROL)]
    assert standby_bench.port.performed == []


def test_forced_arming_otherwise_only_arms(standby_bench: Bench) -> None:
    standby_bench.send(command(ARM, 1, 21196))
    assert standby_bench.port.performed == [Arm()]


@pytest.mark.parametrize("force", [0, 2989, 21196])
@pytest.mark.parametrize("holder", ["", "ada"])
def test_disarming_needs_no_control(standby_bench: Bench, force: int, holder: str) -> None:
    standby_bench.send(command(ARM, 1), CLIENT)
    standby_bench.port.answer()
    standby_bench.sent()
    standby_bench.port.holder = holder
    standby_bench.send(command(ARM, 0, force), OTHER)
    assert standby_bench.port.performed == [Arm(), Disarm()]
    standby_bench.port.answer()
    assert acks(standby_bench.sent()) == [(ARM, ACCEPTED)]
    assert len(standby_bench.port.leases) == 1


def test_emergency_stop_is_open_to_all(standby_bench: Bench) -> None:
    standby_bench.send(command(ARM, 1), CLIENT)
    standby_bench.sent()
    standby_bench.send(command(STOP, 1), OTHER)
    standby_bench.port.stops[0](standby_bench.port.accepted)
    assert acks(standby_bench.sent()) == [(STOP, ACCEPTED)]


def test_emergency_stop_is_repeated_each_time(standby_bench: Bench) -> None:
    for _ in range(3):
        standby_bench.send(command(STOP, 1))
    assert len(standby_bench.port.stops) == 3


def test_emergency_stop_needs_a_client_that_may_command(standby_bench: Bench) -> None:
    sent = standby_bench.send(command(STOP, 1), CLIENT._replace(barred=WATCHER))
    assert acks(sent) == [(STOP, DENIED)]
    assert standby_bench.port.stops == []


def test_termination_with_zero_clears_the_stop(standby_bench: Bench) -> None:
    show(standby_bench, Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR)
    standby_bench.send(command(STOP, 0))
    standby_bench.port.answer()
    assert standby_bench.port.performed == [ClearEmergencyStop(stop_ids=(7,))]
    assert acks(standby_bench.sent()) == [(STOP, ACCEPTED)]


def test_a_client_clears_its_own_stop_before_the_status_shows_it(standby_bench: Bench) -> None:
    """The robot may acknowledge a stop by datagram before its status arrives."""
    show(standby_bench, Vehicle.ACTIVE)
    standby_bench.send(command(STOP, 1))
    standby_bench.send(command(STOP, 0))
    standby_bench.port.answer()
    assert standby_bench.port.performed == [ClearEmergencyStop(stop_ids=(7, 101))], (
        "and no newer one"
    )


def test_a_clear_names_the_stop_seen_last_while_no_status_arrives(standby_bench: Bench) -> None:
    """Another stop may be pressed before the clear is sent."""
    show(standby_bench, Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR)
    del standby_bench.port.telemetry["status"]
    standby_bench.after(0.3)
    standby_bench.send(command(STOP, 0))
    standby_bench.port.answer()
    assert standby_bench.port.performed == [ClearEmergencyStop(stop_ids=(7,))]


def test_a_clear_before_the_first_status_waits_for_one() -> None:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    assert acks(bench.send(command(STOP, 0))) == [(STOP, LATER)]
    assert bench.port.performed == []


@pytest.mark.parametrize("value", [nan, -1.0, 0.25])
def test_termination_with_other_values_is_denied(standby_bench: Bench, value: float) -> None:
    assert acks(standby_bench.send(command(STOP, value))) == [(STOP, DENIED)]
    assert standby_bench.port.stops == []
    assert standby_bench.port.performed == []


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
def test_prearm_checks(
    standby_bench: Bench, vehicle: Vehicle, reason: Reason, expected: str
) -> None:
    show(standby_bench, vehicle, reason)
    sent = standby_bench.send(command(CHECKS))
    assert acks(sent) == [(CHECKS, ACCEPTED)]
    assert words(sent).startswith(expected)
    assert bool(words(sent)) == bool(expected)


def test_prearm_checks_of_a_silent_robot(standby_bench: Bench) -> None:
    del standby_bench.port.telemetry["status"]
    standby_bench.after(0.02)
    assert "no telemetry" in words(standby_bench.send(command(CHECKS)))


def test_prearm_checks_of_an_armed_robot_are_rejected(standby_bench: Bench) -> None:
    show(standby_bench, Vehicle.ACTIVE)
    assert acks(standby_bench.send(command(CHECKS))) == [(CHECKS, LATER)]


FASTEST_M_S, FASTEST_RAD_S = LIMITS["v_max_m_s"], LIMITS["yaw_max_rad_s"]


@pytest.fixture
def manual_bench() -> Bench:
    bench = driving_bench(Mode.MANUAL)
    bench.take_control(CLIENT)
    bench.face.join(CLIENT.client)
    return bench


def echoes(messages: list[MavMessage]) -> list[tuple[int, int, int]]:
    """Return channels 1, 3 and 9 of each RC_CHANNELS."""
    found = (m for m in messages if m.get_type() == "RC_CHANNELS")
    return [(m.chan1_raw, m.chan3_raw, m.chan9_raw) for m in found]


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (manual_control(z=500), (0.4, 0.0)),
        (manual_control(z=-1000), (-0.8, 0.0)),
        (manual_control(y=1000), (0.0, -2.0)),
        (manual_control(z=0x7FFF, y=500), (0.0, -1.0)),
        (manual_control(z=-32768, y=32766), (-0.8, -2.0)),
        (manual_control(x=1000, r=1000), (0.0, 0.0)),
        (manual_control(z=500, target=0), (0.4, 0.0)),
        (rc_override(1500, 0xFFFF, 1750), (0.4, 0.0)),
        (rc_override(2000, 0xFFFF, 1500), (0.0, -2.0)),
        (rc_override(1000), (0.0, 2.0)),
        (rc_override(2200, 0xFFFF, 800), (-0.8, -2.0)),
    ],
)
def test_axes_are_shares_of_the_fastest(
    manual_bench: Bench, message: MavMessage, expected: tuple[float, float]
) -> None:
    manual_bench.send(message)
    assert manual_bench.port.driven[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("message", "lasts_s"), [(manual_control(z=1000), 0.5), (rc_override(1500, 0xFFFF, 2000), 1.0)]
)
def test_speeds_end_with_their_time(
    manual_bench: Bench, message: MavMessage, lasts_s: float
) -> None:
    """Each speed lasts 250 ms on the robot, so the last is sent so long before the end."""
    manual_bench.send(message)
    manual_bench.after(lasts_s - 0.25 - 0.06)
    count = len(manual_bench.port.driven)
    manual_bench.after(0.06)
    assert len(manual_bench.port.driven) == count + 1
    manual_bench.after(1.0)
    assert len(manual_bench.port.driven) == count + 1
    assert set(manual_bench.port.driven) == {(FASTEST_M_S, 0.0)}


def test_released_channels_stop_at_once(manual_bench: Bench) -> None:
    manual_bench.send(rc_override(1500, 0xFFFF, 2000))
    manual_bench.send(rc_override(0, 0xFFFF, 0))
    assert manual_bench.port.driven[-1] == (0.0, 0.0)


def test_channel_that_is_left_keeps_its_value(manual_bench: Bench) -> None:
    manual_bench.send(rc_override(1500, 0xFFFF, 2000))
    manual_bench.send(rc_override(2000))
    assert manual_bench.port.driven[-1] == (FASTEST_M_S, -FASTEST_RAD_S)


@pytest.mark.parametrize("value", [1, 799, 2201, 65534])
def test_channel_out_of_range_changes_nothing(manual_bench: Bench, value: int) -> None:
    manual_bench.send(rc_override(1500, 0xFFFF, 2000))
    manual_bench.send(rc_override(1500, 0xFFFF, value))
    assert manual_bench.port.driven[-1] == (FASTEST_M_S, 0.0)


def test_overrides_are_echoed(manual_bench: Bench) -> None:
    assert echoes(manual_bench.after(1.0)) == []
    manual_bench.send(rc_override(1600, 0xFFFF, 1400, upper=1234))
    found = echoes(manual_bench.after(0.8))
    assert set(found) == {(1600, 1400, 1234)}
    assert echoes(manual_bench.after(2.0)) == []


def test_upper_channels_are_released_by_their_own_value(manual_bench: Bench) -> None:
    manual_bench.send(rc_override(1600, upper=1234))
    manual_bench.send(rc_override(1600, upper=0xFFFE))
    assert echoes(manual_bench.after(0.6))[0] == (1600, 0xFFFF, 0xFFFF)


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.AUTO, Mode.GUIDED, Mode.SMART_RTL])
def test_axes_are_ignored_outside_manual(manual_bench: Bench, mode: Mode) -> None:
    piloting_show(manual_bench, mode)
    for message in (manual_control(z=1000), rc_override(2000, 2000, 2000)):
        assert manual_bench.send(message) == []
    manual_bench.after(0.2)
    assert manual_bench.port.driven == []


def test_axes_do_not_disturb_the_speeds_of_guided() -> None:
    bench = driving_bench(Mode.GUIDED)
    bench.send(local_target(frame=8, vx=0.25))
    bench.port.answer()
    piloting_show(bench, Mode.MANUAL)
    bench.send(manual_control(z=1000))
    bench.after(0.2)
    assert set(bench.port.driven) == {(0.25, 0.0)}


def test_leaving_manual_ends_the_stick(manual_bench: Bench) -> None:
    manual_bench.send(manual_control(z=1000))
    piloting_show(manual_bench, Mode.HOLD)
    piloting_show(manual_bench, Mode.MANUAL)
    manual_bench.after(0.3)
    assert manual_bench.port.driven == [(FASTEST_M_S, 0.0)]


def test_axes_of_another_client_are_refused(manual_bench: Bench) -> None:
    assert "take control" in words(manual_bench.send(manual_control(z=1000), OTHER))
    assert manual_bench.port.driven == []


def test_axes_without_control_take_none() -> None:
    bench = driving_bench(Mode.MANUAL)
    assert "take control" in words(bench.send(rc_override(2000, 2000, 2000)))
    assert bench.port.leases == []
    assert bench.port.driven == []


def test_axes_for_another_vehicle_are_ignored(manual_bench: Bench) -> None:
    assert manual_bench.send(manual_control(z=1000, target=2)) == []
    assert manual_bench.port.driven == []


def test_stick_ends_with_the_loss_of_control(manual_bench: Bench) -> None:
    manual_bench.send(manual_control(z=1000))
    manual_bench.port.telemetry["lease"] = LeaseStatus(
        time_ns=0, lapses_ms=1000, held=1, holder="ground/7", name="ada"
    )
    manual_bench.after(0.35)
    count = len(manual_bench.port.driven)
    manual_bench.after(0.4)
    assert len(manual_bench.port.driven) == count


def test_unknown_limits_drive_nothing(manual_bench: Bench) -> None:
    manual_bench.vehicle.parameters.clear()
    manual_bench.send(manual_control(z=1000))
    assert manual_bench.port.driven == []


def test_rc_channels_is_a_stream_of_its_group(manual_bench: Bench) -> None:
    source = manual_bench.vehicle.catalogue.find(mavlink.MAVLINK_MSG_ID_RC_CHANNELS)
    assert source is not None
    assert source.group == mavlink.MAV_DATA_STREAM_RC_CHANNELS
