from math import nan
from typing import Any

import pytest

from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.motion.pilot import EnterGuided
from ground.client.operations.commands import Arm, Hold, Resume, ReturnHome, SetMode
from ground.client.operations.missions import StartMission
from ground.client.operations.parameters import ParameterChanged, ResetParameter, SetParameter
from ground.client.operations.session import Operation
from protocol.wire.enums import MissionState, Mode, Vehicle
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from tests.support.gateway.fake_port import Bench
from tests.support.gateway.messages import acks, command, words
from tests.support.gateway.piloting import driving_bench, performed, show

ACCEPTED, LATER, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
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


@pytest.mark.parametrize("mode", [1, 3, 5, 6, 7, 8, 9, 16, 65535, -1, 2**31])
def test_mode_that_is_missing_is_denied(bench: Bench, mode: int) -> None:
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
    show(bench, Mode.SMART_RTL)
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
    show(bench, Mode.SMART_RTL)
    show(bench, Mode.HOLD)
    show(bench, Mode.SMART_RTL)
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
    show(bench, Mode.HOLD, MissionState.PAUSED)
    set_mode(bench, 10)
    assert performed(bench) == [SetMode(mode=Mode.AUTO)]


def test_auto_starts_a_finished_mission_again(bench: Bench) -> None:
    show(bench, Mode.AUTO, MissionState.DONE)
    set_mode(bench, 10)
    assert performed(bench) == [StartMission(item=None, arms=False)]


def test_auto_after_manual_starts_at_the_current_item(bench: Bench) -> None:
    show(bench, Mode.AUTO, MissionState.RUNNING)
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
    show(bench, Mode.HOLD, MissionState.READY, Vehicle.STANDBY)
    assert set_mode(bench, 10) == [(176, ACCEPTED)]
    assert performed(bench) == [SetMode(mode=Mode.AUTO)]
    show(bench, Mode.AUTO, MissionState.READY, Vehicle.STANDBY)
    bench.send(command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1))
    bench.port.answer()
    show(bench, Mode.AUTO, MissionState.READY)
    assert performed(bench) == [Arm(), FROM_CURRENT]
    bench.port.refuse(Reason.PLACE_UNKNOWN)
    assert "mission not started" in words(bench.sent())


def test_mission_does_not_start_for_another_operator(bench: Bench) -> None:
    show(bench, Mode.HOLD, MissionState.READY, Vehicle.STANDBY)
    set_mode(bench, 10)
    performed(bench)
    bench.port.telemetry["lease"] = LeaseStatus(
        time_ns=0, lapses_ms=1000, held=1, holder="ground/7", name="ada"
    )
    bench.after(0.5)
    show(bench, Mode.AUTO, MissionState.READY)
    assert performed(bench) == []


def test_guided_again_keeps_the_goal(bench: Bench) -> None:
    set_mode(bench, 15)
    show(bench, Mode.GUIDED)
    performed(bench)
    assert set_mode(bench, 15) == [(176, ACCEPTED)]
    bench.now_ns += 5_000_000_000
    assert set_mode(bench, 15) == [(176, ACCEPTED)]
    assert performed(bench) == []


def test_guided_after_hold_drops_the_goal(bench: Bench) -> None:
    show(bench, Mode.GUIDED)
    set_mode(bench, 4)
    set_mode(bench, 15)
    assert performed(bench) == [Hold(), EnterGuided()]


def test_first_heartbeat_is_waited_for(bench: Bench) -> None:
    sent = bench.send(command(mavlink.MAV_CMD_DO_SET_MODE, 1, 0))
    bench.port.refuse(Reason.NO_OPERATOR)
    assert acks(sent + bench.sent()) == []
    bench.after(0.02)
    bench.port.answer()
    assert acks(bench.sent()) == [(176, ACCEPTED)]
    assert performed(bench) == [SetMode(mode=Mode.MANUAL)] * 2


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
    show(bench, Mode.HOLD, MissionState.READY, Vehicle.STANDBY)
    bench.send(command(300))
    bench.port.refuse(Reason.NOT_ARMED)
    assert acks(bench.sent()) == [(300, FAILED)]


def test_pause_and_continue(bench: Bench) -> None:
    for value in (0, 1):
        bench.send(command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, value))
    assert performed(bench) == [Hold(), Resume()]


def test_change_speed_limits_goals_and_missions(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 0.25))
    assert performed(bench) == [SetParameter(name="v_max_m_s", value=0.25)]
    bench.port.answer(ParameterChanged(name="v_max_m_s", asked=0.25, now=0.25))
    assert acks(bench.sent()) == [(178, ACCEPTED)]


def test_change_speed_to_the_default(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, -2))
    assert performed(bench) == [ResetParameter(name="v_max_m_s")]


def test_change_speed_that_changes_nothing(bench: Bench) -> None:
    assert acks(bench.send(command(178, 1, -1))) == [(178, ACCEPTED)]
    assert performed(bench) == []


def test_change_speed_of_climbing_is_denied(bench: Bench) -> None:
    assert acks(bench.send(command(178, 2, 0.25))) == [(178, DENIED)]


def test_change_speed_out_of_range_is_denied(bench: Bench) -> None:
    bench.send(command(178, 1, 99))
    refused = ParameterChanged(name="v_max_m_s", asked=99, now=None, refusal="allowed: 0.01 to 3")
    bench.port.answer(refused)
    sent = bench.sent()
    assert acks(sent) == [(178, DENIED)]
    assert "allowed" in words(sent)


@pytest.mark.parametrize(("value", "result"), [(0, ACCEPTED), (1, DENIED)])
def test_set_reverse(bench: Bench, value: int, result: int) -> None:
    assert acks(bench.send(command(194, value))) == [(194, result)]


def test_refusals_name_no_verbs_of_the_command_line(bench: Bench) -> None:
    bench.send(command(mavlink.MAV_CMD_MISSION_START))
    bench.port.refuse(Reason.NO_MISSION)
    assert words(bench.sent()) == "refused: there is no mission to act on"
