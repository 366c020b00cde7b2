"""GUIDED: targets, speeds and setpoints of a client."""

from math import cos, inf, nan, pi, sin
from typing import Any

import pytest

from checks.harness.messages import make
from gateways.mavlink.coordinates import PER_DEG
from gateways.mavlink.mav_service import WATCHER
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.motion.guided import ReachedGoals
from gateways.mavlink.motion.pilot import (
    BeginDrive,
    DriveBegun,
    DriveOver,
    EndDrive,
    EnterGuided,
    LimitDrive,
)
from gateways.mavlink.motion.setpoints import SetpointError, Velocity, attitude_of, setpoint_of
from ground.client.goal import Destination
from ground.commands.goto import Goto
from ground.commands.mode import SetMode
from ground.missions.qgroundcontrol import to_global
from protocol.wire.enums import Command, GoalState, LeaseAction, MissionState, Mode, Vehicle
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.gateway.fake_port import (
    CLIENT,
    ORIGIN,
    OTHER,
    PLACE,
    SPEEDS,
    Bench,
    accept_all,
    acks,
    attitude,
    command,
    command_int,
    driving_bench,
    global_target,
    local_target,
    mission_status,
    numbered,
    odometry,
    performed,
    show,
    status,
    words,
)
from tests.support.ground.client import Stage, perform

ACCEPTED = 0
DENIED = 2
FAILED = 4
UNSUPPORTED_FRAME = 9
NOT_IN_CONTROL = 10
TO_MANUAL, TO_GUIDED = SetMode(mode=Mode.MANUAL), SetMode(mode=Mode.GUIDED)
LATITUDE_DEG, LONGITUDE_DEG = to_global(ORIGIN, 12.0, -7.0)
X, Y = round(LATITUDE_DEG * PER_DEG), round(LONGITUDE_DEG * PER_DEG)


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


def test_reposition_with_speed_limits_this_drive(bench: Bench) -> None:
    bench.send(reposition(0.25, 1, 0, nan))
    assert_at(goal_of(bench), 12, -7)
    bench.port.answer()
    assert performed(bench) == [LimitDrive(0.25, for_goal=True)]
    assert acks(bench.sent()) == []
    bench.port.answer()
    assert acks(bench.sent()) == [(192, ACCEPTED)]


@each(("reason", "result"), [(Reason.NO_GOAL, ACCEPTED), (Reason.PARAMETER_OUT_OF_RANGE, DENIED)])
def test_reposition_whose_goal_is_reached_at_once_is_accepted(reason: Reason, result: int) -> None:
    bench = driving_bench(Mode.GUIDED)
    bench.send(reposition(0.25, 1, 0, nan))
    bench.port.answer()
    bench.port.refuse(reason)
    assert acks(bench.sent()) == [(192, result)]


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
    assert words(bench.sent()).startswith("goal refused: goal is outside of the fence")


@each("mode", [Mode.MANUAL, Mode.HOLD, Mode.AUTO, Mode.SMART_RTL])
def test_setpoints_are_ignored_outside_guided(mode: Mode) -> None:
    bench = driving_bench(mode)
    for message in (local_target(vx=1.0), global_target(X, Y), attitude(thrust=1.0)):
        assert bench.send(message) == []
    assert performed(bench) == []
    assert bench.port.driven == []


def test_bad_setpoint_says_why(bench: Bench) -> None:
    assert "accelerations" in words(bench.send(local_target(mask=0xC07)))
    assert "frame 12" in words(bench.send(local_target(frame=12)))


def test_setpoint_of_another_client_is_refused(bench: Bench) -> None:
    bench.take_control(CLIENT)
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


BEGUN = DriveBegun(1, 7)
BEGIN_DRIVE, END_IN_GUIDED, END_IN_HOLD = (
    BeginDrive(),
    EndDrive(7, Mode.GUIDED),
    EndDrive(7, Mode.HOLD),
)


def start_speeds(bench: Bench) -> None:
    """Send a speed; the robot changes to MANUAL."""
    bench.send(local_target(frame=8, vx=0.5))
    assert performed(bench) == [BEGIN_DRIVE]
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
    assert performed(bench) == [END_IN_GUIDED]
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
    assert performed(bench) == [BEGIN_DRIVE, END_IN_GUIDED]


def rests_at_a_speed_each_second(bench: Bench, timeout_s: float) -> int:
    """Send a speed each second for 10 s, each third is lost; return the changes to rest."""
    bench.vehicle.guided_timeout_s = timeout_s
    start_speeds(bench)
    rests = 0
    for second in range(1, 11):
        for _ in range(50):
            bench.after(0.02)
            rests += END_IN_GUIDED in performed(bench)
            accept_all(bench)
        if second % 3:
            bench.send(local_target(frame=8, vx=0.5))
            accept_all(bench)
    return rests


def test_slow_stream_of_speeds_needs_a_longer_time_out() -> None:
    assert rests_at_a_speed_each_second(driving_bench(Mode.GUIDED), 1.0) > 0
    assert rests_at_a_speed_each_second(driving_bench(Mode.GUIDED), 3.0) == 0


def test_goal_that_is_reached_in_guided_is_item_0(bench: Bench) -> None:
    """ArduPilot's Rover sends so, and DroneKit and MavKit wait for it."""

    def reached(mission: MissionState = MissionState.NONE, **changes: int) -> list[int]:
        fields = {"vehicle": Vehicle.ACTIVE, "mode": Mode.GUIDED} | changes
        bench.port.telemetry["status"] = status(**fields)
        bench.port.telemetry["mission"] = mission_status(mission)
        found = bench.after(1.0)
        return [one.seq for one in found if one.get_type() == "MISSION_ITEM_REACHED"]

    bench.vehicle.lossy = ()
    over, way = GoalState.REACHED, GoalState.DRIVING
    assert reached(goal=way, goal_id=5) == []
    assert reached(goal=over, goal_id=5) == [0]
    assert reached(goal=over, goal_id=5) == []
    assert reached(goal=over, goal_id=6) == [0], "it stood there already"
    assert reached(goal=GoalState.STUCK, goal_id=7) == []
    assert reached(goal=over, goal_id=8, mode=Mode.SMART_RTL) == []
    assert reached(MissionState.RUNNING, goal=way, goal_id=9) == []
    assert 0 not in reached(MissionState.DONE, goal=over, goal_id=9)


def test_goal_of_before_the_gateway_is_not_reached_again() -> None:
    bench = Bench(ReachedGoals)
    bench.port.telemetry["status"] = status(mode=Mode.GUIDED, goal=GoalState.REACHED, goal_id=5)
    assert bench.after(1.0) == []


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
    assert performed(bench) == [END_IN_GUIDED, BEGIN_DRIVE]
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
    assert END_IN_GUIDED not in performed(bench)


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
    assert performed(bench)[-1] == END_IN_GUIDED


def test_speeds_end_with_the_loss_of_control(bench: Bench) -> None:
    start_speeds(bench)
    bench.port.telemetry["lease"] = LeaseStatus(
        time_ns=0, lapses_ms=1000, held=1, holder="ground/7", name="ada"
    )
    bench.after(0.5)
    assert bench.port.driven[-1] == (0.0, 0.0)
    assert performed(bench) == [END_IN_HOLD]
    assert bench.vehicle.modes.number == Mode.MANUAL


def test_refused_speeds_say_why(bench: Bench) -> None:
    bench.port.holder = "ada"
    assert "ada" in words(bench.send(local_target(vx=0.5)))
    assert bench.port.driven == []


def test_robot_that_cannot_return_to_guided_holds(bench: Bench) -> None:
    start_speeds(bench)
    bench.after(1.3)
    bench.port.refuse(Reason.EMERGENCY_STOPPED)
    assert performed(bench) == [END_IN_GUIDED, END_IN_HOLD]


def test_drive_that_another_operator_has_ended_stays_ended(bench: Bench) -> None:
    """The hold of another operator may cross the time-out."""
    start_speeds(bench)
    bench.after(1.3)
    show(bench, Mode.HOLD)
    assert performed(bench) == [END_IN_GUIDED]
    bench.port.answer(DriveOver())
    bench.after(0.5)
    assert bench.vehicle.modes.number == Mode.HOLD
    assert set(performed(bench)) <= {END_IN_HOLD}


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
    bench.send(command(213, 90, 0.25, 0))
    bench.port.answer()
    assert acks(bench.sent()) == [(213, ACCEPTED)]
    assert bench.port.driven == [(0.25, 0.0)]
    assert acks(bench.send(command(213, 90, 0.1, 0))) == [(213, ACCEPTED)]


def test_yaw_and_speed_that_are_refused_leave_no_lease(bench: Bench) -> None:
    bench.port.telemetry["lease"] = make(LeaseStatus)
    bench.after(0.1)
    bench.send(command(213, 90, 0.25, 0))
    bench.port.refuse(Reason.NO_SENSES)
    assert acks(bench.sent()) == [(213, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)]
    assert [action for action, _ in bench.port.leases] == [LeaseAction.TAKE, LeaseAction.RELEASE]


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


EAST = odometry(x_m=3.0, y_m=4.0, heading_rad=0.0)
LOCAL_NED, OFFSET_NED, BODY_NED, BODY_OFFSET_NED = 1, 7, 8, 9


def position(frame: int, x: float, y: float, yaw: float | None = None) -> Destination:
    mask = 0xDF8 if yaw is None else 0x9F8
    message = local_target(frame=frame, mask=mask, x=x, y=y, yaw=yaw or 0.0)
    found = setpoint_of(message, EAST, ORIGIN)
    assert isinstance(found, Destination)
    return found


def velocity(pose: Any = EAST, **fields: Any) -> Velocity:
    found = setpoint_of(local_target(**fields), pose, ORIGIN)
    assert isinstance(found, Velocity)
    return found


@each(
    ("frame", "expected"),
    [
        (LOCAL_NED, (2.0, 1.0)),
        (OFFSET_NED, (5.0, 5.0)),
        (BODY_NED, (4.0, 2.0)),
        (BODY_OFFSET_NED, (4.0, 2.0)),
    ],
)
def test_position_in_each_frame(frame: int, expected: tuple[float, float]) -> None:
    goal = position(frame, x=1.0, y=2.0)
    assert (goal.x_m, goal.y_m) == pytest.approx(expected)
    assert goal.heading_rad is None


def test_yaw_of_a_position_is_its_heading() -> None:
    assert position(LOCAL_NED, 1, 2, yaw=pi / 2).heading_rad == pytest.approx(0.0)
    assert position(BODY_NED, 1, 2, yaw=pi / 2).heading_rad == pytest.approx(-pi / 2)
    assert position(LOCAL_NED, 1, 2, yaw=nan).heading_rad is None


def test_global_position() -> None:
    latitude_deg, longitude_deg = to_global(ORIGIN, 12.0, -7.0)
    place = round(latitude_deg * PER_DEG), round(longitude_deg * PER_DEG)
    found = setpoint_of(global_target(lat=place[0], lon=place[1]), EAST, ORIGIN)
    assert isinstance(found, Destination)
    assert (found.x_m, found.y_m) == pytest.approx((12.0, -7.0), abs=0.02)


@each(
    ("fields", "expected"),
    [
        ({"vx": 0.5}, Velocity(0.5, heading_rad=pi / 2)),
        ({"vy": 0.5}, Velocity(0.5, heading_rad=0.0)),
        ({"vx": 0.5, "mask": SPEEDS & ~2048, "yaw_rate": 0.2}, Velocity(0.5, -0.2)),
        ({"vx": -0.5, "mask": SPEEDS & ~2048, "yaw_rate": 0.2}, Velocity(-0.5, -0.2)),
        ({"vy": -0.5, "mask": SPEEDS & ~1024, "yaw": pi / 2}, Velocity(-0.5, heading_rad=0.0)),
        ({"vx": 0.5, "frame": BODY_NED}, Velocity(0.5)),
        ({"vx": -0.5, "frame": BODY_NED}, Velocity(-0.5)),
        ({"vy": 0.5, "frame": BODY_NED}, Velocity(0.5, heading_rad=-pi / 2)),
        ({"mask": 0x5FF, "yaw_rate": 0.3}, Velocity(0.0, -0.3)),
        ({"mask": 0x9FF, "yaw": 0.0}, Velocity(heading_rad=pi / 2)),
        ({"mask": 0x9FF, "yaw": 0.5, "frame": BODY_NED}, Velocity(heading_rad=-0.5)),
    ],
)
def test_velocities(fields: dict[str, Any], expected: Velocity) -> None:
    found = velocity(**fields)
    assert found[:2] == pytest.approx(expected[:2])
    assert found.heading_rad == pytest.approx(expected.heading_rad)


def test_position_goes_before_velocity() -> None:
    assert isinstance(setpoint_of(local_target(mask=0xDC0), EAST, ORIGIN), Destination)


@each("mask", [2040, 3064, 3580, 0, 0xDF8 & ~0x40, 0xDF8 | 512])
def test_position_needs_no_bit_of_the_acceleration(mask: int) -> None:
    """These are masks of MavKit and others, which ArduPilot's Rover drives to."""
    found = setpoint_of(local_target(mask=mask, x=1.0, y=2.0), EAST, ORIGIN)
    assert isinstance(found, Destination)
    assert (found.x_m, found.y_m) == (2.0, 1.0)


@each("mask", [SPEEDS | 512, SPEEDS & ~64, SPEEDS & ~192, SPEEDS & ~384])
def test_velocity_needs_one_bit_of_the_acceleration(mask: int) -> None:
    assert velocity(vx=0.5, mask=mask) == velocity(vx=0.5)


@each(
    "fields",
    [
        {"frame": 0},
        {"frame": 2},
        {"frame": 12},
        {"frame": 255},
        {"mask": 0xC07},
        {"mask": 0xFFFF},
        {"mask": 0xDFF},
        {"vx": nan},
        {"vy": inf},
        {"mask": SPEEDS & ~2048, "yaw_rate": nan},
        {"mask": SPEEDS & ~1024, "yaw": inf},
        {"mask": 0xDF8, "x": nan},
        {"mask": 0xDF8, "x": 1e38},
        {"mask": 0xDF8, "x": -inf, "frame": BODY_NED},
        {"mask": 0xDF8, "x": 1.9e6, "y": 1.9e6, "frame": BODY_NED, "pose": pi / 4},
    ],
)
def test_setpoint_that_cannot_be_followed(fields: dict[str, Any]) -> None:
    pose = odometry(heading_rad=fields.pop("pose", 0.0))
    with pytest.raises(SetpointError):
        setpoint_of(local_target(**fields), pose, ORIGIN)


@each(
    ("lat", "lon"),
    [(0, 0), (2**31 - 1, 0), (-(2**31), -(2**31)), (900_000_001, 1), (-1, 180 * 10**7)],
)
def test_place_that_is_none(lat: int, lon: int) -> None:
    with pytest.raises(SetpointError):
        setpoint_of(global_target(lat=lat, lon=lon), EAST, ORIGIN)


@each("frame", [OFFSET_NED, BODY_NED])
def test_offset_without_a_pose_is_refused(frame: int) -> None:
    with pytest.raises(SetpointError, match="pose"):
        setpoint_of(local_target(frame=frame, mask=0xDF8, x=1.0), None, ORIGIN)


def quaternion(yaw_rad: float) -> tuple[float, ...]:
    return cos(yaw_rad / 2), 0.0, 0.0, sin(yaw_rad / 2)


def test_attitude_is_a_share_of_the_speed_and_a_turn() -> None:
    found = attitude_of(attitude(thrust=0.5, rate=0.25), 0.8)
    assert found == Velocity(0.4, -0.25)
    assert attitude_of(attitude(thrust=-9.0), 0.8).speed_m_s == pytest.approx(-0.8)


def test_attitude_without_a_rate_is_a_heading() -> None:
    found = attitude_of(attitude(thrust=0.5, mask=4, q=quaternion(pi / 2)), 0.8)
    assert found.heading_rad == pytest.approx(0.0)


@each(
    "message",
    [
        attitude(thrust=nan),
        attitude(rate=inf),
        attitude(mask=64),
        attitude(mask=4, q=(0.0,) * 4),
        attitude(mask=4, q=(nan,) * 4),
    ],
)
def test_attitude_that_cannot_be_followed(message: MavMessage) -> None:
    with pytest.raises(SetpointError):
        attitude_of(message, 0.8)


def test_attitude_needs_the_fastest_speed() -> None:
    with pytest.raises(SetpointError, match="fastest"):
        attitude_of(attitude(), None)


def test_twist_turns_to_the_heading_before_it_drives() -> None:
    wanted = Velocity(0.5, heading_rad=pi / 2)
    assert wanted.twist(0.0) == pytest.approx((0.0, 1.5), abs=1e-9)
    assert wanted.twist(pi / 2) == pytest.approx((0.5, 0.0))
    assert wanted.twist(None) == (0.0, 0.0)


def test_twist_is_bounded() -> None:
    assert Velocity(1e30, -1e30).twist(None) == pytest.approx((5.0, -4.0 * pi))


@each("aborted", [Reason.NONE, Reason.NOTHING_TO_ABORT])
def test_entering_guided_drops_the_goal(aborted: Reason) -> None:
    stage = Stage(Reason.NONE, aborted, attended=True)
    assert perform(EnterGuided(), stage).ok
    mode, abort = stage.bus.requests
    assert abort.command == Command.SIDESTEP_ABORT_GOAL
    assert (mode.command, mode.param2) == (Command.DO_SET_MODE, Mode.GUIDED)


def test_guided_that_is_refused_ends_no_goal() -> None:
    stage = Stage(Reason.NO_OPERATOR, attended=True)
    assert not perform(EnterGuided(), stage).ok
    (mode,) = stage.bus.requests
    assert mode.command == Command.DO_SET_MODE
