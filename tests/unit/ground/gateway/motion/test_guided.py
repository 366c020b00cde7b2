from math import inf, nan, pi

import pytest

from gateways.mavlink.coordinates import PER_DEG
from gateways.mavlink.mav_service import WATCHER
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from ground.client.goal import Destination
from ground.client.operations.commands import SetMode
from ground.client.operations.goals import Goto
from ground.client.operations.parameters import ParameterChanged, SetParameter
from ground.missions.qgroundcontrol import to_global
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.gateway.fake_port import CLIENT, ORIGIN, OTHER, Bench
from tests.support.gateway.messages import (
    PLACE,
    acks,
    attitude,
    command,
    command_int,
    global_target,
    local_target,
    numbered,
    words,
)
from tests.support.gateway.piloting import accept_all, driving_bench, performed, show

ACCEPTED, DENIED, FAILED, UNSUPPORTED_FRAME, NOT_IN_CONTROL = 0, 2, 4, 9, 10
TO_MANUAL, TO_GUIDED = SetMode(mode=Mode.MANUAL), SetMode(mode=Mode.GUIDED)
LATITUDE_DEG, LONGITUDE_DEG = to_global(ORIGIN, 12.0, -7.0)
X, Y = round(LATITUDE_DEG * PER_DEG), round(LONGITUDE_DEG * PER_DEG)
SECOND = 1_000_000_000


@pytest.fixture
def bench() -> Bench:
    return driving_bench(Mode.GUIDED)


def goal_of(bench: Bench) -> Destination:
    """Return the goal of the only operation, which arms no robot."""
    (goto,) = performed(bench)
    assert isinstance(goto, Goto)
    assert not goto.arms
    assert goto.goal is not None
    return goto.goal


def assert_at(goal: Destination, x_m: float, y_m: float, heading_rad: float | None = None) -> None:
    assert (goal.x_m, goal.y_m) == pytest.approx((x_m, y_m), abs=0.02)
    assert goal.heading_rad == pytest.approx(heading_rad)


def reposition(*params: float, x: int = X, y: int = Y, frame: int = 0) -> MavMessage:
    return command_int(mavlink.MAV_CMD_DO_REPOSITION, *params, x=x, y=y, frame=frame)


def item(current: int = 2, frame: int = 3, number: int = 16, x: float = LATITUDE_DEG) -> MavMessage:
    return numbered(
        mavlink.MAVLink_mission_item_message(
            1, 0, 0, frame, number, current, 0, 0, 0, 0, 0, x, LONGITUDE_DEG, 10
        )
    )


def mission_acks(messages: list[MavMessage]) -> list[int]:
    return [m.type for m in messages if m.get_type() == "MISSION_ACK"]


# DO_REPOSITION


def test_reposition_is_a_goal(bench: Bench) -> None:
    bench.send(reposition(-1, 1, 0, nan))
    assert_at(goal_of(bench), 12, -7)
    bench.port.answer()
    assert acks(bench.sent()) == [(192, ACCEPTED)]


def test_reposition_as_command_long_takes_degrees(bench: Bench) -> None:
    bench.send(command(192, -1, 0, 0, nan, LATITUDE_DEG, LONGITUDE_DEG, 0))
    assert_at(goal_of(bench), 12, -7)


def test_reposition_with_yaw_has_a_heading(bench: Bench) -> None:
    bench.send(reposition(-1, 1, 0, pi / 2))
    assert_at(goal_of(bench), 12, -7, 0.0)


def test_reposition_with_relative_yaw(bench: Bench) -> None:
    bench.send(reposition(-1, 3, 0, pi / 2))
    assert_at(goal_of(bench), 12, -7, -pi / 2)


def test_reposition_with_speed_limits_it_first(bench: Bench) -> None:
    bench.send(reposition(0.25, 1, 0, nan))
    assert performed(bench) == [SetParameter(name="v_max_m_s", value=0.25)]
    bench.port.answer(ParameterChanged(name="v_max_m_s", asked=0.25, now=0.25))
    assert_at(goal_of(bench), 12, -7)
    bench.port.answer()
    assert acks(bench.sent()) == [(192, ACCEPTED)]


def test_reposition_outside_guided_needs_the_flag() -> None:
    bench = driving_bench(Mode.AUTO)
    assert acks(bench.send(reposition(-1, 0, 0, nan))) == [(192, DENIED)]
    bench.send(reposition(-1, 1, 0, nan))
    assert_at(goal_of(bench), 12, -7)


@pytest.mark.parametrize(
    ("x", "y"), [(0, 0), (2**31 - 1, Y), (X, 2**31 - 1), (900_000_001, Y), (-X, Y), (X, -(2**31))]
)
def test_reposition_to_no_place_is_denied(bench: Bench, x: int, y: int) -> None:
    sent = bench.send(reposition(-1, 1, 0, nan, x=x, y=y))
    assert acks(sent) == [(192, DENIED)]
    assert words(sent)
    assert performed(bench) == []


@pytest.mark.parametrize("params", [(inf, 1, 0, nan), (-1, 1, 0, inf), (-1, 1, 0, -inf)])
def test_reposition_with_infinite_values_is_denied(bench: Bench, params: list[float]) -> None:
    assert acks(bench.send(reposition(*params))) == [(192, DENIED)]
    assert performed(bench) == []


@pytest.mark.parametrize("frame", [1, 2, 8, 9, 12, 255])
def test_reposition_in_a_local_frame_is_refused(bench: Bench, frame: int) -> None:
    assert acks(bench.send(reposition(-1, 1, 0, nan, frame=frame))) == [(192, UNSUPPORTED_FRAME)]


def test_reposition_of_an_unarmed_robot_fails(bench: Bench) -> None:
    bench.send(reposition(-1, 1, 0, nan))
    bench.port.refuse(Reason.NOT_ARMED)
    sent = bench.sent()
    assert acks(sent) == [(192, FAILED)]
    assert "not armed" in words(sent)


# Guided mission items


def test_guided_item_is_a_goal(bench: Bench) -> None:
    bench.send(item())
    assert_at(goal_of(bench), 12, -7)
    bench.port.answer()
    assert mission_acks(bench.sent()) == [mavlink.MAV_MISSION_ACCEPTED]


def test_guided_item_int_is_a_goal(bench: Bench) -> None:
    bench.send(
        numbered(
            mavlink.MAVLink_mission_item_int_message(1, 1, 0, 6, 16, 2, 0, 0, 0, 0, 0, X, Y, 10)
        )
    )
    assert_at(goal_of(bench), 12, -7)


def test_mission_items_are_left_to_the_mission_protocol(bench: Bench) -> None:
    invalid_sequence = 13
    assert mission_acks(bench.send(item(current=1))) == [invalid_sequence]
    assert performed(bench) == []


@pytest.mark.parametrize(
    ("message", "result"),
    [
        (item(current=3), mavlink.MAV_MISSION_UNSUPPORTED),
        (item(number=20), mavlink.MAV_MISSION_UNSUPPORTED),
        (item(frame=1), mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
        (item(x=nan), mavlink.MAV_MISSION_INVALID_PARAM5_X),
        (item(x=1e30), mavlink.MAV_MISSION_INVALID_PARAM5_X),
    ],
)
def test_bad_guided_item_is_refused(bench: Bench, message: MavMessage, result: int) -> None:
    sent = bench.send(message)
    assert mission_acks(sent) == [result]
    assert words(sent)
    assert performed(bench) == []


def test_guided_item_outside_guided_is_refused() -> None:
    assert mission_acks(driving_bench(Mode.AUTO).send(item())) == [mavlink.MAV_MISSION_ERROR]


def test_guided_item_without_control_is_denied(bench: Bench) -> None:
    bench.port.holder = "ada"
    sent = bench.send(item())
    assert mission_acks(sent) == [mavlink.MAV_MISSION_DENIED]
    assert "ada" in words(sent)


# Streams of positions


def test_position_stream_acts_once(bench: Bench) -> None:
    for _ in range(40):
        bench.send(local_target(mask=PLACE, x=1.0, y=2.0))
        accept_all(bench)
        bench.after(0.1)
    assert_at(goal_of(bench), 2, 1)


def test_position_acts_again_after_a_pause(bench: Bench) -> None:
    for _ in range(2):
        bench.send(global_target(X, Y))
        accept_all(bench)
        bench.after(1.1)
    assert len(performed(bench)) == 2


def test_position_acts_again_after_another_mode(bench: Bench) -> None:
    for mode in (Mode.GUIDED, Mode.HOLD, Mode.GUIDED):
        show(bench, mode)
        bench.send(local_target(mask=PLACE, x=1.0, y=2.0))
        accept_all(bench)
    assert len(performed(bench)) == 2


def test_only_the_newest_position_follows(bench: Bench) -> None:
    for x in range(50):
        bench.send(local_target(mask=PLACE, x=x, y=0.0))
    accept_all(bench)
    first, last = performed(bench)
    assert isinstance(first, Goto)
    assert isinstance(last, Goto)
    assert first.goal is not None
    assert last.goal is not None
    assert (first.goal.y_m, last.goal.y_m) == (0.0, 49.0)


def test_refused_position_says_why(bench: Bench) -> None:
    bench.send(local_target(mask=PLACE, x=1.0, y=2.0))
    bench.port.refuse(Reason.OUTSIDE_FENCE)
    assert "outside of the fence" in words(bench.sent())


@each("mode", [Mode.MANUAL, Mode.HOLD, Mode.AUTO, Mode.SMART_RTL])
def test_setpoints_are_ignored_outside_guided(mode: Mode) -> None:
    bench = driving_bench(mode)
    for message in (local_target(vx=1.0), global_target(X, Y), attitude(thrust=1.0)):
        assert bench.send(message) == []
    assert performed(bench) == []
    assert bench.port.driven == []


def test_bad_setpoint_says_why(bench: Bench) -> None:
    assert "acceleration" in words(bench.send(local_target(mask=0)))
    assert "frame 12" in words(bench.send(local_target(frame=12)))


def test_setpoint_of_another_client_is_refused(bench: Bench) -> None:
    bench.vehicle.control.ensure(CLIENT, lambda _: None)
    sent = bench.send(local_target(vx=0.5), OTHER)
    assert "MAVLink 255" in words(sent)
    assert performed(bench) == []


def test_setpoint_of_a_watching_client_is_refused(bench: Bench) -> None:
    assert "sign" in words(bench.send(local_target(vx=1), CLIENT._replace(barred=WATCHER)))
    assert performed(bench) == []


def test_unarmed_robot_gets_the_same_position_once_a_second() -> None:
    bench = driving_bench(Mode.GUIDED, Vehicle.STANDBY)
    for _ in range(40):
        bench.send(local_target(mask=PLACE, x=1.0, y=2.0))
        while bench.port.waiting:
            bench.port.refuse(Reason.NOT_ARMED)
        bench.after(0.1)
    assert len(performed(bench)) == 4
