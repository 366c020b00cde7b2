"""A displayed value is live or shown with its age."""

from math import inf, nan

import pytest

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
from ground.client.telemetry import Age, Telemetry, age_of
from ground.text.status_parts import fitted, in_words
from protocol.topics import DECISION, HEARTBEAT, ODOMETRY, STATUS, TEXT
from protocol.wire.enums import GoalState, Mode, Navigator, Vehicle
from protocol.wire.messages import AvoidanceDecision, NavigatorStatus, PlanarOdometry
from protocol.wire.reasons import Reason
from tests.support.air import Air

MS = 1_000_000


def status(
    goal: int = GoalState.DRIVING, vehicle: int = Vehicle.ACTIVE, mode: int = Mode.GUIDED
) -> NavigatorStatus:
    return NavigatorStatus(
        time_ns=12_400 * MS,
        goal_started_ns=0,
        goal_ended_ns=0,
        goal_id=1,
        goal_x_m=1.0,
        goal_y_m=0.0,
        goal_heading_rad=0.0,
        goal_distance_m=3.25,
        vehicle=vehicle,
        mode=mode,
        goal=goal,
        vehicle_reason=0,
        goal_reason=Reason.BLOCKED,
        navigator=Navigator.VGM,
        side=1,
    )


ODOMETRY_NOW = PlanarOdometry(
    time_ns=1,
    x_m=1.0,
    y_m=2.0,
    heading_rad=1.0,
    speed_m_s=0.25,
    yaw_rate_rad_s=0.0,
    cov_xx_m2=0.0,
    cov_xy_m2=0.0,
    cov_xh_m_rad=0.0,
    cov_yy_m2=0.0,
    cov_yh_m_rad=0.0,
    cov_hh_rad2=0.0,
)


@pytest.fixture
def air() -> Air:
    return Air()


@pytest.fixture
def telemetry(air: Air) -> Telemetry:
    return Telemetry(air, "r1")


DECISION_NOW = AvoidanceDecision(
    time_ns=1,
    nearest_bearing_rad=0.0,
    nearest_range_m=0.5,
    zone_m=0.3,
    goal_bearing_rad=0.0,
    rotation_rad=0.0,
    virtual_x_m=0.0,
    virtual_y_m=0.0,
    speed_m_s=0.0,
    yaw_rate_rad_s=0.0,
    branch=0,
    guard=0,
)


def test_goal_line_begins_with_state_and_distance(air: Air, telemetry: Telemetry) -> None:
    air.put(STATUS, status(), 0)
    air.put(ODOMETRY, ODOMETRY_NOW, 0)
    air.put(DECISION, DECISION_NOW, 0)
    assert in_words(goal_line(telemetry, 10 * MS, 0)) == (
        "driving   3.25 m to go  0.25 m/s  echo 0.50 m  12 s  (has not moved although it tries to)"
    )


def test_forty_columns_are_enough_for_all_but_the_reason(air: Air, telemetry: Telemetry) -> None:
    air.put(STATUS, status(GoalState.AVOIDING), 0)
    air.put(ODOMETRY, ODOMETRY_NOW, 0)
    air.put(DECISION, DECISION_NOW, 0)
    shown = fitted(goal_line(telemetry, 10 * MS, 0), 39, dims=True)
    assert "".join(piece.text for piece in shown) == "avoiding 3.25 m 0.25 m/s echo 0.50 12 s"


def test_a_status_of_the_goal_before_is_not_shown(air: Air, telemetry: Telemetry) -> None:
    air.put(STATUS, status(GoalState.REACHED), 0)
    assert "reached" in in_words(goal_line(telemetry, 0, 0, goal_id=1))
    assert in_words(goal_line(telemetry, 0, 0, goal_id=2)) == (
        "waiting for the robot to show this goal"
    )


def test_an_old_number_is_not_shown(air: Air, telemetry: Telemetry) -> None:
    air.put(STATUS, status(), 0)
    air.put(ODOMETRY, ODOMETRY_NOW, 0)
    assert in_words(watch_line(telemetry, 2_000 * MS)) == (
        "state -- (2.0 s)  pose -- (2.0 s)  goal -- (2.0 s)  echo --  cycle --  heartbeat --"
    )


def test_a_fading_number_has_its_age_and_a_live_one_has_not(air: Air, telemetry: Telemetry) -> None:
    air.put(STATUS, status(), 0)
    air.put(ODOMETRY, ODOMETRY_NOW, 100 * MS)
    _, pose, goal, *_ = watch_line(telemetry, 140 * MS)
    assert (pose.text, pose.age_s) == ("pose 1.00 2.00 57 deg", None)
    assert (goal.text, goal.age_s) == ("goal 3.25 m", 0.14)


def test_silence_is_shown_with_its_duration(telemetry: Telemetry) -> None:
    assert in_words(goal_line(telemetry, 0, 1_500 * MS)) == "no message from the robot for 1.5 s"
    assert in_words(goal_line(telemetry, 0, 0)) == "waiting for the robot's status"


def test_line_of_several_robots_has_names(air: Air, telemetry: Telemetry) -> None:
    assert short_line(telemetry, "r2", 0).text == "r2 --"
    air.put(STATUS, status(), 0)
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


def test_seen_returns_message_and_age(air: Air, telemetry: Telemetry) -> None:
    assert telemetry.seen(STATUS, 5).age is Age.GONE
    assert telemetry.fresh(STATUS, 5) is None
    air.put(STATUS, status(), 0)
    seen = telemetry.seen(STATUS, 130 * MS)
    assert (seen.message, seen.age_ns, seen.age) == (status(), 130 * MS, Age.DIM)
    assert telemetry.fresh(STATUS, 130 * MS) == status()


def test_states_of_a_newer_robot_are_shown_as_numbers() -> None:
    assert state_of(status(goal=99, vehicle=77)) == "Vehicle 77 GUIDED GoalState 99"


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
