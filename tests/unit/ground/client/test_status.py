"""What a client sees: events, values with their ages, and the factor of simulated time."""

import asyncio
from collections.abc import Callable
from math import inf, nan
from typing import Any

import pytest

from checks.harness.messages import make
from ground.client.events import (
    EventDetector,
    GoalChanged,
    LeaseChanged,
    MissionChanged,
    ModeChanged,
    TextReceived,
    VehicleChanged,
)
from ground.client.requests import HeartbeatTimer
from ground.client.status_line import (
    doing,
    echo_of,
    goal_line,
    metres,
    short_line,
    state_of,
    watch_line,
)
from ground.client.streams import Stream, TopicStreams
from ground.client.telemetry import Age, Telemetry, age_of
from ground.client.time_factor import TimeFactor, chosen_speed
from ground.text.wording import fitted, in_words
from protocol.topics import DECISION, HEARTBEAT, ODOMETRY, STATUS, TEXT
from protocol.wire.enums import GoalState, MissionState, Mode, Severity, Vehicle
from protocol.wire.messages import (
    AvoidanceDecision,
    LeaseStatus,
    MissionStatus,
    NavigatorStatus,
    PlanarOdometry,
    Statustext,
)
from protocol.wire.reasons import Reason, reason_text
from runtime.clock import ManualClock
from runtime.units import NS_PER_MS as MS
from runtime.units import NS_PER_S as S
from tests.support.each import each
from tests.support.ground.client import ScriptedBus, lease_of
from tests.support.ground.client import status as client_status
from tests.support.played_bus import PlayedBus


def status(
    goal: int = GoalState.DRIVING, vehicle: int = Vehicle.ACTIVE, mode: int = Mode.GUIDED
) -> NavigatorStatus:
    return make(
        NavigatorStatus,
        time_ns=12_400 * MS,
        goal_id=1,
        goal_x_m=1.0,
        goal_distance_m=3.25,
        vehicle=vehicle,
        mode=mode,
        goal=goal,
        goal_reason=Reason.BLOCKED,
    )


ODOMETRY_NOW = make(PlanarOdometry, time_ns=1, x_m=1.0, y_m=2.0, heading_rad=1.0, speed_m_s=0.25)


@pytest.fixture
def bus() -> PlayedBus:
    return PlayedBus(ManualClock())


@pytest.fixture
def telemetry(bus: PlayedBus) -> Telemetry:
    return Telemetry(bus, "r1")


DECISION_NOW = make(AvoidanceDecision, time_ns=1, nearest_range_m=0.5, zone_m=0.3)


def test_goal_line_begins_with_state_and_distance(bus: PlayedBus, telemetry: Telemetry) -> None:
    bus.say(STATUS, status())
    bus.say(ODOMETRY, ODOMETRY_NOW)
    bus.say(DECISION, DECISION_NOW)
    assert in_words(goal_line(telemetry, 10 * MS, 0)) == (
        "driving   3.25 m to go  0.25 m/s  echo 0.50 m  12 s  (has not moved although it tries to)"
    )


def test_forty_columns_are_enough_for_all_but_the_reason(
    bus: PlayedBus, telemetry: Telemetry
) -> None:
    bus.say(STATUS, status(GoalState.AVOIDING))
    bus.say(ODOMETRY, ODOMETRY_NOW)
    bus.say(DECISION, DECISION_NOW)
    shown = fitted(goal_line(telemetry, 10 * MS, 0), 39, dims=True)
    assert "".join(piece.text for piece in shown) == "avoiding 3.25 m 0.25 m/s echo 0.50 12 s"


def test_a_status_of_the_goal_before_is_not_shown(bus: PlayedBus, telemetry: Telemetry) -> None:
    bus.say(STATUS, status(GoalState.REACHED))
    assert "reached" in in_words(goal_line(telemetry, 0, 0, goal_id=1))
    assert in_words(goal_line(telemetry, 0, 0, goal_id=2)) == (
        "waiting for the robot to show this goal"
    )


def test_an_old_number_is_not_shown(bus: PlayedBus, telemetry: Telemetry) -> None:
    bus.say(STATUS, status())
    bus.say(ODOMETRY, ODOMETRY_NOW)
    assert in_words(watch_line(telemetry, 2_000 * MS)) == (
        "state -- (2.0 s)  pose -- (2.0 s)  goal -- (2.0 s)  echo --  cycle --  heartbeat --"
    )


def test_a_fading_number_has_its_age_and_a_live_one_has_not(
    bus: PlayedBus, telemetry: Telemetry
) -> None:
    bus.say(STATUS, status())
    bus.say(ODOMETRY, ODOMETRY_NOW, at_ns=100 * MS)
    _, pose, goal, *_ = watch_line(telemetry, 140 * MS)
    assert (pose.text, pose.age_s) == ("pose 1.00 2.00 57 deg", None)
    assert (goal.text, goal.age_s) == ("goal 3.25 m", 0.14)


def test_silence_is_shown_with_its_duration(telemetry: Telemetry) -> None:
    assert in_words(goal_line(telemetry, 0, 1_500 * MS)) == "no message from the robot for 1.5 s"
    assert in_words(goal_line(telemetry, 0, 0)) == "waiting for the robot's status"


def test_line_of_several_robots_has_names(bus: PlayedBus, telemetry: Telemetry) -> None:
    assert short_line(telemetry, "r2", 0).text == "r2 --"
    bus.say(STATUS, status())
    assert short_line(telemetry, "r2", 0)[:2] == ("r2 driving 3.25 m", "r2 3.25 m")


def test_what_it_does_is_one_word_unless_it_may_not_drive() -> None:
    assert doing(status()) == "driving"
    assert doing(status(mode=Mode.HOLD)) == "hold"
    assert doing(status(mode=Mode.MANUAL, goal=GoalState.ABORTED)) == "manual"
    assert doing(status(vehicle=Vehicle.EMERGENCY_STOP)) == "emergency stop"
    assert doing(status(goal=99)) == "goalstate 99"


def test_a_stream_fades_and_an_event_stays() -> None:
    assert age_of(STATUS, 60 * MS) is Age.LIVE
    assert age_of(STATUS, 130 * MS) is Age.DIM
    assert age_of(STATUS, 260 * MS) is Age.GONE
    assert age_of(HEARTBEAT, 400 * MS) is Age.LIVE
    assert age_of(TEXT, 10**15) is Age.LIVE


def test_seen_returns_message_and_age(bus: PlayedBus, telemetry: Telemetry) -> None:
    assert telemetry.seen(STATUS, 5).age is Age.GONE
    assert telemetry.fresh(STATUS, 5) is None
    bus.say(STATUS, status())
    seen = telemetry.seen(STATUS, 130 * MS)
    assert (seen.message, seen.age_ns, seen.age) == (status(), 130 * MS, Age.DIM)
    assert telemetry.fresh(STATUS, 130 * MS) == status()


def test_states_of_a_newer_robot_are_shown_as_numbers() -> None:
    assert state_of(status(goal=99, vehicle=77)) == "Vehicle 77 GUIDED GoalState 99"


def test_goal_under_way_is_kept_while_the_robot_holds() -> None:
    for goal in (GoalState.ACCEPTED, GoalState.DRIVING, GoalState.AVOIDING, GoalState.ALIGNING):
        assert state_of(status(goal, mode=Mode.HOLD)) == "ACTIVE HOLD goal kept"
    assert state_of(status(GoalState.REACHED, mode=Mode.HOLD)) == "ACTIVE HOLD REACHED"
    assert state_of(status(GoalState.DRIVING)) == "ACTIVE GUIDED DRIVING"


def test_no_number_is_missing_and_infinity_is_no_echo() -> None:
    assert (metres(nan), metres(inf), metres(0.5)) == ("--", "--", "0.50 m")
    assert (echo_of(nan), echo_of(inf), echo_of(0.5)) == ("--", "none", "0.50 m")


def test_a_beat_is_due_at_once_and_then_by_the_faster_clock() -> None:
    pace = HeartbeatTimer()
    assert pace.due(0, 0)
    assert not pace.due(199 * MS, 0)
    assert pace.due(200 * MS, 0)
    assert not pace.due(201 * MS, 199 * MS)
    assert pace.due(202 * MS, 400 * MS)


def test_first_status_emits_all_events_a_repeat_none() -> None:
    detector = EventDetector("open/0a")
    first = detector.receive(client_status(time_ns=S))
    assert first[:2] == [VehicleChanged(Vehicle.ACTIVE, ""), ModeChanged(Mode.GUIDED)]
    assert isinstance(first[2], GoalChanged)
    assert detector.receive(client_status(time_ns=2 * S, goal_distance_m=0.5)) == []


def test_change_events_carry_their_reason() -> None:
    detector = EventDetector("open/0a")
    detector.receive(client_status(time_ns=S))
    failed = client_status(Vehicle.FAILSAFE, time_ns=2 * S, vehicle_reason=Reason.NO_OPERATOR)
    why = reason_text(Reason.NO_OPERATOR)
    assert detector.receive(failed) == [VehicleChanged(Vehicle.FAILSAFE, why)]
    reached = client_status(
        Vehicle.FAILSAFE,
        time_ns=3 * S,
        vehicle_reason=Reason.NO_OPERATOR,
        goal_id=7,
        goal=GoalState.REACHED,
    )
    assert detector.receive(reached) == [GoalChanged(7, GoalState.REACHED, "", 1.5)]


def test_reordered_status_emits_nothing_a_restart_does() -> None:
    detector = EventDetector("open/0a")
    detector.receive(client_status(time_ns=60 * S))
    assert detector.receive(client_status(Vehicle.STANDBY, time_ns=60 * S - 50_000_000)) == []
    assert VehicleChanged(Vehicle.BOOT, "") in detector.receive(
        client_status(Vehicle.BOOT, time_ns=S)
    )


def test_number_that_this_version_does_not_know_stays_a_number() -> None:
    found = EventDetector("").receive(client_status(time_ns=S, mode=99))
    assert ModeChanged(99) in found


def test_lease_mission_and_texts_are_events() -> None:
    detector = EventDetector("anna/2")
    assert detector.receive(lease_of("anna")) == [LeaseChanged("anna/1", "anna", True)]
    free = LeaseStatus(time_ns=2, lapses_ms=0, held=0, holder="", name="")
    assert detector.receive(free) == [LeaseChanged("", "", False)]
    running = make(
        MissionStatus, time_ns=1, mission_id=1, count=3, current=1, state=MissionState.RUNNING
    )
    assert detector.receive(running) == [MissionChanged(MissionState.RUNNING, 2, 3, "running")]
    text = Statustext(severity=Severity.WARNING, text="low", id=0, chunk_seq=0)
    assert detector.receive(text) == [TextReceived(Severity.WARNING, "low")]


@each(
    ("reason", "words"),
    [
        (Reason.BY_HAND, "taken over: driven by hand"),
        (Reason.DISARMED, "aborted: disarmed by the operator"),
        (Reason.BUMPER, "failed: bumper contact"),
    ],
)
def test_end_of_a_mission_is_told_in_the_words_of_the_command_line(
    reason: Reason, words: str
) -> None:
    ended = MissionStatus(
        time_ns=1, mission_id=1, hold_left_ms=0, count=3, current=1,
        state=MissionState.FAILED, reason=reason,
    )  # fmt: skip
    (event,) = EventDetector("").receive(ended)
    assert event == MissionChanged(MissionState.FAILED, 2, 3, words)


async def test_stream_keeps_the_newest_and_counts_the_rest() -> None:
    stream: Stream[int] = Stream(3)
    for item in range(10):
        stream.offer(item)
    await stream.aclose()
    assert [item async for item in stream] == [7, 8, 9]
    assert stream.dropped == 7


async def test_stream_wakes_its_reader_from_another_thread() -> None:
    stream: Stream[int] = Stream()
    waiting = asyncio.ensure_future(anext(stream))
    await asyncio.sleep(0)
    await asyncio.to_thread(stream.offer, 7)
    assert await waiting == 7


async def test_topic_is_subscribed_once_for_all_its_streams() -> None:
    bus: Any = ScriptedBus(ManualClock(), [])
    hub = TopicStreams(bus, "r1")
    first, second = hub.stream(STATUS), hub.stream(STATUS)
    assert bus.subscribed == [("r1", STATUS.path)]
    await first.aclose()
    assert hub.latest(STATUS) is None
    bus.say(STATUS, client_status())
    assert hub.latest(STATUS) is not None
    await second.aclose()
    assert hub.latest(STATUS) is None, "it is unsubscribed with its last stream"


def after(
    seconds: float, stamp_ns: Callable[[int], int], *, speed: float | None = 1.0
) -> tuple[str, str]:
    """Return words and hint after a time in which a stamp came every 50 ms."""
    factor, now_ns = TimeFactor(speed), 0
    while now_ns <= seconds * S:
        factor.take(stamp_ns(now_ns), now_ns)
        now_ns += 50 * MS
    return factor.words(now_ns), factor.hint(now_ns)


@each(
    ("pace", "speed", "words", "hint"),
    [
        (1.0, 1.0, "SIM 1.0x", ""),
        (0.95, 1.0, "SIM 0.9x", ""),
        (0.8, 1.0, "SIM 0.8x", "computer busy"),
        (4.0, 5.0, "SIM 4.0x", "computer busy"),
        (4.0, inf, "SIM 4.0x", ""),
        (0.3, None, "SIM 0.3x", ""),
        (0.0, 1.0, "SIM 0.0x", "stands still"),
    ],
)
def test_slow_simulation_is_told_from_the_chosen_speed(
    pace: float, speed: float | None, words: str, hint: str
) -> None:
    assert after(6.0, lambda now_ns: round(now_ns * pace), speed=speed) == (words, hint)


@each(("factor", "pace"), [(0.5, 0.5), (0.01, 0.2), (3.0, 1.0)])
def test_ages_follow_a_slow_simulation_within_limits(factor: float, pace: float) -> None:
    measured, stamp_ns = TimeFactor(), 0
    assert measured.pace(0) == 1.0
    for number in range(100):
        stamp_ns = round(number * 50 * MS * factor)
        measured.take(stamp_ns, number * 50 * MS)
    assert measured.pace(100 * 50 * MS) == pytest.approx(pace)


def test_two_seconds_are_needed() -> None:
    assert after(1.9, lambda _: 0) == ("SIM", "")


def test_restarted_plant_begins_a_new_window() -> None:
    factor, shown = TimeFactor(1.0), set()
    for now_ns in range(0, 8 * S, 50 * MS):
        before = now_ns < 5 * S
        factor.take(now_ns + 30 * S if before else now_ns - 5 * S, now_ns)
        shown.add((factor.words(now_ns), factor.hint(now_ns)))
    assert shown == {("SIM", ""), ("SIM 1.0x", "")}


def test_factor_without_news_of_the_plant_is_unknown() -> None:
    factor = TimeFactor(1.0)
    for number in range(100):
        factor.take(number * 10 * MS, number * 50 * MS)
    assert factor.hint(5 * S) == "computer busy"
    assert (factor.words(10 * S), factor.hint(10 * S)) == ("SIM", "")
    factor.take(100 * S, 20 * S)
    assert factor.words(20 * S) == "SIM"


def test_speed_of_the_command_line_is_a_number() -> None:
    assert (chosen_speed("max"), chosen_speed("0.5")) == (inf, 0.5)
