"""What the robot publishes: telemetry, wheel commands, texts, and their timing."""

from collections.abc import Callable
from math import inf, isnan
from time import time
from typing import cast

from hypothesis import given
from hypothesis import strategies as st

from protocol.bus.bus import Bus
from protocol.topics import DRIVE, HEARTBEAT
from protocol.wire.enums import Branch, GoalState, MissionState, Severity, SystemState
from protocol.wire.messages import WheelCommand
from protocol.wire.reasons import Reason
from protocol.wire.statustext import PIECE_BYTES, StatustextAssembler
from robot import telemetry
from robot.core import reasons, states
from robot.core.parameters import DEFAULTS
from robot.core.values import Decision, Outputs, Twist
from robot.hosting import InProcessCore
from robot.mission import MissionExecutor
from robot.reports import Reports
from robot.run import epoch
from robot.storage import Store
from robot.telemetry import ChangeLog
from robot.vehicle import ReportTimer, RobotVehicle
from runtime.clock import ManualClock
from runtime.units import NS_PER_MS as MS
from runtime.units import NS_PER_S as SECOND
from runtime.units import PERIOD_NS
from tests.support.each import each
from tests.support.played_bus import PlayedBus
from tests.support.robots import Desk, armed


def test_status_without_a_goal_has_nan_and_no_times() -> None:
    status = telemetry.status(Desk().vehicle.state, 0, 5 * MS, 5)
    assert isnan(status.goal_x_m)
    assert isnan(status.goal_heading_rad)
    assert (status.goal_started_ns, status.goal_ended_ns) == (0, 0)
    assert status.goal_distance_m == inf


def test_goal_times_are_converted_to_the_sensor_clock() -> None:
    desk = armed()
    desk.goto(2, 0)  # at 50 ms on the core's clock
    status = telemetry.status(desk.vehicle.state, 9, 1_000 * MS, 80)
    assert status.goal_started_ns == 970 * MS
    assert status.goal_ended_ns == 0
    assert status.goal_id == 9


def test_a_goal_that_ended_at_the_very_start_has_ended() -> None:
    desk = Desk()
    desk.step()
    desk.now_ns = 0
    desk.arm()
    desk.now_ns = 0
    desk.goto(2, 0)
    desk.vehicle.stop(reasons.SHUT_DOWN, 0)
    status = telemetry.status(desk.vehicle.state, 9, 0, 0)
    assert status.goal == GoalState.ABORTED
    assert status.goal_ended_ns > 0


def test_heartbeat_is_that_of_an_ardupilot_rover() -> None:
    desk = Desk()
    desk.step()
    beat = telemetry.heartbeat(desk.vehicle.state)
    assert (beat.type, beat.autopilot, beat.base_mode) == (10, 3, 1)
    assert (beat.custom_mode, beat.system_status) == (states.HOLD, SystemState.STANDBY)
    desk.arm()
    assert telemetry.heartbeat(desk.vehicle.state).base_mode == 129


def test_missing_decision_is_nan() -> None:
    message = telemetry.decision(Outputs(0, 0, 0, Twist(0.0, 0.0), None), 0.3, 7)
    assert isnan(message.nearest_range_m)
    assert message.branch == Branch.NONE


def test_no_echo_is_infinitely_far_and_has_no_bearing() -> None:
    chosen = Decision(states.TO_GOAL, None, inf, 0.1, 0.0, 1.0, 2.0, inf)
    message = telemetry.decision(Outputs(1, 2, 0, Twist(0.1, 0.2), chosen), 0.3, 7)
    assert message.nearest_range_m == inf
    assert isnan(message.nearest_bearing_rad)
    assert (message.virtual_x_m, message.virtual_y_m, message.zone_m) == (1.0, 2.0, 0.3)


def decoded(epoch_s: int, stamp_ns: int, sense_seq: int) -> list[WheelCommand]:
    """Return the fields of a command and a brake that a motor driver reads."""
    bus = PlayedBus(ManualClock())
    reports, publisher = Reports(cast(Bus, bus), epoch_s), bus.publisher(DRIVE)
    box = bus.mailbox(DRIVE)
    read: list[tuple[WheelCommand, int] | None] = []
    publisher.heard = lambda message: bus.say(DRIVE, message)
    reports.command(5, 6, 900, -900)
    read.append(box.latest())
    reports.brake(stamp_ns, sense_seq)
    read.append(box.latest())
    return [newest[0] for newest in read if newest is not None]


def beats_in(seconds: float, *, factor: float, late_ms: Callable[[int], int]) -> int:
    """Return the number of heartbeats in wall time with a tick every 50 ms of simulated time."""
    clock, vehicle = ManualClock(10 * SECOND), RobotVehicle(DEFAULTS, Store(None))
    bus = PlayedBus(clock)
    reports = Reports(cast(Bus, bus))
    beats = bus.publisher(HEARTBEAT).said
    begun_ns = clock.now_ns()
    for tick in range(round(seconds * factor * 20)):
        due_ns = begun_ns + round(tick * PERIOD_NS / factor) + late_ms(tick) * MS
        clock.advance(due_ns - clock.now_ns())
        reports.events(vehicle, 0, tick * PERIOD_NS + late_ms(tick) * MS)
    return len(beats)


def test_heartbeats_keep_their_rate_although_ticks_jitter() -> None:
    jitter = (0, 1, 0, 3, 2, 0, 1)
    assert beats_in(30.0, factor=1.0, late_ms=lambda tick: jitter[tick % 7]) in (150, 151)


@each("factor", [0.1, 0.3])
def test_heartbeats_go_on_when_simulated_time_is_slow(factor: float) -> None:
    period_s = max(0.3, 0.05 / factor) + 0.05 / factor
    assert beats_in(30.0, factor=factor, late_ms=lambda _: 0) >= 30.0 / period_s - 1


def test_every_wheel_command_carries_the_epoch() -> None:
    assert [command.epoch for command in decoded(1_800_000_000, 5, 6)] == [1_800_000_000] * 2


def test_the_epoch_is_the_time_in_seconds() -> None:
    before = int(time())
    assert before <= epoch() <= int(time())


@each("stamp_ns", [0, (1 << 62) - 1, 1 << 62, 1 << 64, 1 << 80, -1])
@each("sense_seq", [0, (1 << 32) - 1, 1 << 32, -1])
def test_last_brake_has_a_valid_stamp(stamp_ns: int, sense_seq: int) -> None:
    """Invalid stamps would let the wheels run on until the last command expires."""
    last = decoded(0, stamp_ns, sense_seq)[-1]
    assert (last.seq, last.left_mrad_s, last.right_mrad_s, last.ttl_ms) == (1, 0, 0, 0)


def news() -> ChangeLog:
    core = InProcessCore(DEFAULTS)
    return ChangeLog(core.state.machine, MissionExecutor(core))


@each("length", [1, 49, 50, 51, 99, 100, 101, 150, 400])
def test_text_is_complete_only_with_its_last_piece(length: int) -> None:
    words = "".join(chr(97 + at % 26) for at in range(length))
    pieces = news().text(Severity.INFO, words)
    texts = StatustextAssembler()
    assert [texts.receive(piece) for piece in pieces] == [""] * (len(pieces) - 1) + [words]
    assert len(pieces) == (1 if length <= PIECE_BYTES else length // PIECE_BYTES + 1)
    assert {piece.id for piece in pieces} == {0 if length <= PIECE_BYTES else 1}


def test_empty_text_has_no_pieces() -> None:
    assert news().text(Severity.INFO, "") == []


@each(
    ("reason", "words", "severity"),
    [
        (Reason.BY_OPERATOR, "mission aborted: by the operator", Severity.INFO),
        (Reason.BY_HAND, "mission taken over: driven by hand", Severity.INFO),
        (Reason.REPLACED, "mission taken over: replaced by a new goal", Severity.INFO),
        (Reason.DISARMED, "mission aborted: disarmed by the operator", Severity.INFO),
        (Reason.BY_EMERGENCY_STOP, "mission aborted by the emergency stop", Severity.INFO),
        (Reason.BUMPER, "mission FAILED: bumper contact", Severity.ERROR),
    ],
)
def test_mission_that_an_operator_ended_has_not_failed(
    reason: Reason, words: str, severity: Severity
) -> None:
    core = InProcessCore(DEFAULTS)
    mission = MissionExecutor(core)
    log = ChangeLog(core.state.machine, mission)
    mission.state, mission.reason = MissionState.FAILED, reason
    (text,) = log.since_last_time()
    assert (text.text, text.severity) == (words, severity)


def test_first_value_is_published_at_once() -> None:
    assert ReportTimer(10).due(None, 0)


def test_change_is_published_at_once_and_repeats_per_period() -> None:
    timer = ReportTimer(10)
    published = [timer.due(what, now) for what, now in [(1, 0), (1, 9), (1, 10), (2, 11), (2, 20)]]
    assert published == [True, False, True, True, False]


def test_a_late_call_does_not_delay_the_following_ones() -> None:
    timer = ReportTimer(20)
    published = [now for now in (0, 21, 40, 63, 80) if timer.due("x", now)]
    assert published == [0, 21, 40, 63, 80], "the mean period is 20"


def test_after_a_pause_the_period_counts_anew() -> None:
    timer = ReportTimer(20)
    published = [now for now in (0, 100, 110, 119, 120) if timer.due("x", now)]
    assert published == [0, 100, 120]


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 30)), max_size=50))
def test_no_value_waits_longer_than_the_period(
    asked: list[tuple[bool, int]],
) -> None:
    timer, now, published_at, newest = ReportTimer(20), 0, -99, None
    for what, later in asked:
        now += later
        due = timer.due(what, now)
        if what is not newest or now - published_at >= 20:
            assert due
        published_at, newest = (now, what) if due else (published_at, newest)


@given(st.lists(st.integers(1, 30), min_size=1, max_size=100))
def test_the_mean_rate_of_an_unchanged_value_is_at_most_one_a_period(gaps: list[int]) -> None:
    timer, now, published = ReportTimer(20), 0, 0
    for gap in gaps:
        published += timer.due("x", now)
        now += gap
    assert published <= 1 + now // 20
