from math import inf, nan

import pytest

from gateways.mavlink.mavlink_dialect import MavMessage
from gateways.mavlink.motion.pilot import BeginDrive, DriveBegun, DriveOver, EndDrive
from ground.client.operations.goals import Goto
from protocol.wire.enums import Mode
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from tests.support.gateway.fake_port import Bench
from tests.support.gateway.messages import PLACE, acks, attitude, command, local_target, words
from tests.support.gateway.piloting import driving_bench, performed, show

ACCEPTED, DENIED, FAILED = 0, 2, 4
BEGUN = DriveBegun(1, 7)
TO_MANUAL, TO_GUIDED, TO_HOLD = BeginDrive(), EndDrive(7, Mode.GUIDED), EndDrive(7, Mode.HOLD)


@pytest.fixture
def bench() -> Bench:
    return driving_bench(Mode.GUIDED)


def start_speeds(bench: Bench) -> None:
    """Send a speed; the robot changes to MANUAL."""
    bench.send(local_target(frame=8, vx=0.5))
    assert performed(bench) == [TO_MANUAL]
    bench.port.answer(BEGUN)
    show(bench, Mode.MANUAL)


def shown(messages: list[MavMessage]) -> set[int]:
    return {m.custom_mode for m in messages if m.get_type() == "HEARTBEAT"}


def test_speeds_drive_and_clients_see_guided(bench: Bench) -> None:
    bench.send(local_target(frame=8, vx=0.5))
    bench.port.answer()
    assert bench.port.driven == [(0.5, 0.0)]
    sent = bench.after(0.02)
    show(bench, Mode.MANUAL)
    sent += bench.after(0.8)
    assert shown(sent) <= {Mode.GUIDED}
    assert bench.vehicle.modes.number == Mode.GUIDED
    assert len(bench.port.driven) == 13
    assert set(bench.port.driven) == {(0.5, 0.0)}


def test_speeds_end_a_second_after_the_last(bench: Bench) -> None:
    """Each speed lasts 250 ms on the robot, so the last is sent so long before the end.

    In MANUAL without speeds the robot brakes, so it leaves that mode a moment later.
    """
    start_speeds(bench)
    bench.after(0.68)
    count = len(bench.port.driven)
    bench.after(0.06)
    assert len(bench.port.driven) > count
    bench.after(0.4)
    assert performed(bench) == []
    bench.after(0.04)
    assert performed(bench) == [TO_GUIDED]
    bench.port.answer()
    show(bench, Mode.GUIDED)
    bench.after(1.0)
    assert len(bench.port.driven) == count + 1
    assert bench.vehicle.modes.number == Mode.GUIDED


def test_speed_that_has_timed_out_before_the_robot_follows_is_not_sent(bench: Bench) -> None:
    """The simulation found it (seed 763): a link that kept the change of mode for 3 s."""
    bench.send(local_target(frame=8, vx=0.5))
    bench.after(0.8)
    bench.port.answer(BEGUN)
    show(bench, Mode.MANUAL)
    bench.after(1.0)
    assert bench.port.driven == []
    assert performed(bench) == [TO_MANUAL, TO_GUIDED]


def test_stream_of_speeds_goes_on(bench: Bench) -> None:
    start_speeds(bench)
    for _ in range(30):
        bench.send(local_target(frame=8, vx=0.5))
        bench.after(0.1)
    assert performed(bench) == []
    assert (0.0, 0.0) not in bench.port.driven


def test_speed_while_the_robot_brakes_drives_again(bench: Bench) -> None:
    start_speeds(bench)
    bench.after(1.1)
    bench.send(local_target(frame=8, vx=0.25))
    assert performed(bench) == []
    assert bench.port.driven[-1] == (0.25, 0.0)


def test_speed_after_the_time_out_drives_again(bench: Bench) -> None:
    start_speeds(bench)
    bench.after(1.3)
    bench.send(local_target(frame=8, vx=0.25))
    bench.port.answer()
    assert performed(bench) == [TO_GUIDED, TO_MANUAL]
    bench.port.answer()
    assert bench.port.driven[-1] == (0.25, 0.0)


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.AUTO, Mode.SMART_RTL])
def test_speeds_end_with_another_mode(bench: Bench, mode: Mode) -> None:
    start_speeds(bench)
    bench.send(command(176, 1, mode))
    bench.port.answer()
    count = len(bench.port.driven)
    show(bench, mode)
    bench.send(local_target(frame=8, vx=0.5))
    bench.after(1.5)
    assert len(bench.port.driven) == count
    assert TO_GUIDED not in performed(bench)


def test_manual_ends_the_speeds_and_is_shown(bench: Bench) -> None:
    start_speeds(bench)
    bench.send(command(176, 1, Mode.MANUAL))
    bench.port.answer()
    bench.after(0.02)
    assert bench.port.driven[-1] == (0.0, 0.0)
    assert bench.vehicle.modes.number == Mode.MANUAL


def test_guided_again_does_not_interrupt_the_speeds(bench: Bench) -> None:
    start_speeds(bench)
    assert acks(bench.send(command(176, 1, Mode.GUIDED))) == [(176, ACCEPTED)]
    assert performed(bench) == []


def test_goal_ends_the_speeds(bench: Bench) -> None:
    start_speeds(bench)
    bench.send(local_target(mask=PLACE, x=1.0, y=2.0))
    assert [type(one) for one in performed(bench)] == [Goto]
    bench.port.answer()
    show(bench, Mode.GUIDED)
    bench.after(1.5)
    assert performed(bench) == []


def test_refused_goal_leaves_the_robot_standing_in_guided(bench: Bench) -> None:
    start_speeds(bench)
    bench.send(local_target(mask=PLACE, x=1.0, y=2.0))
    bench.port.refuse(Reason.OUTSIDE_FENCE)
    bench.after(0.04)
    assert bench.port.driven[-1] == (0.0, 0.0)
    assert performed(bench)[-1] == TO_GUIDED


def test_speeds_end_with_the_loss_of_control(bench: Bench) -> None:
    start_speeds(bench)
    bench.port.telemetry["lease"] = LeaseStatus(
        time_ns=0, lapses_ms=1000, held=1, holder="ground/7", name="ada"
    )
    bench.after(0.5)
    assert bench.port.driven[-1] == (0.0, 0.0)
    assert performed(bench) == [TO_HOLD]
    assert bench.vehicle.modes.number == Mode.MANUAL


def test_refused_speeds_say_why(bench: Bench) -> None:
    bench.port.holder = "ada"
    assert "ada" in words(bench.send(local_target(vx=0.5)))
    assert bench.port.driven == []


def test_robot_that_cannot_return_to_guided_holds(bench: Bench) -> None:
    start_speeds(bench)
    bench.after(1.3)
    bench.port.refuse(Reason.EMERGENCY_STOPPED)
    assert performed(bench) == [TO_GUIDED, TO_HOLD]


def test_drive_that_another_operator_has_ended_stays_ended(bench: Bench) -> None:
    """The hold of another operator may cross the time-out."""
    start_speeds(bench)
    bench.after(1.3)
    show(bench, Mode.HOLD)
    assert performed(bench) == [TO_GUIDED]
    bench.port.answer(DriveOver())
    bench.after(0.5)
    assert bench.vehicle.modes.number == Mode.HOLD
    assert set(performed(bench)) <= {TO_HOLD}


def test_clients_see_guided_while_the_drive_ends(bench: Bench) -> None:
    start_speeds(bench)
    sent = bench.after(1.3)
    show(bench, Mode.HOLD)
    sent += bench.after(0.1)
    bench.port.answer()
    show(bench, Mode.GUIDED)
    sent += bench.after(1.0)
    assert shown(sent) == {Mode.GUIDED}


def test_attitude_drives(bench: Bench) -> None:
    bench.send(attitude(thrust=0.5, rate=0.25))
    bench.port.answer()
    assert bench.port.driven == [(0.4, -0.25)]


def test_attitude_waits_for_the_speed_limit(bench: Bench) -> None:
    bench.vehicle.parameters.clear()
    assert "not known" in words(bench.send(attitude(thrust=0.5)))
    assert performed(bench) == []


def test_yaw_and_speed_command_drives(bench: Bench) -> None:
    assert acks(bench.send(command(213, 90, 0.25, 0))) == [(213, ACCEPTED)]
    bench.port.answer()
    assert bench.port.driven == [(0.25, 0.0)]


def test_yaw_and_speed_relative_to_the_robot(bench: Bench) -> None:
    bench.send(command(213, 90, 0.25, 1))
    bench.port.answer()
    speed_m_s, yaw_rate_rad_s = bench.port.driven[0]
    assert speed_m_s == pytest.approx(0.0)
    assert yaw_rate_rad_s < -1.0


@pytest.mark.parametrize("params", [(nan, 1), (inf, 1), (0, nan)])
def test_yaw_and_speed_must_be_numbers(bench: Bench, params: tuple[float, float]) -> None:
    assert acks(bench.send(command(213, *params))) == [(213, DENIED)]


def test_yaw_and_speed_outside_guided_fails() -> None:
    assert acks(driving_bench(Mode.HOLD).send(command(213, 90, 0.25))) == [(213, FAILED)]
