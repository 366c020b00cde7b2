from math import inf, isnan

from protocol.wire.enums import Branch, GoalState, SystemState
from robot import telemetry
from robot.core import reasons, states
from robot.core.values import Decision, Outputs, Twist
from tests.support.robot.vehicles import MS, Desk


def test_status_without_a_goal_has_nan_and_no_times() -> None:
    status = telemetry.status(Desk().vehicle.state, 0, 5 * MS, 5)
    assert isnan(status.goal_x_m)
    assert isnan(status.goal_heading_rad)
    assert (status.goal_started_ns, status.goal_ended_ns) == (0, 0)
    assert status.goal_distance_m == inf


def test_goal_times_are_converted_to_the_sensor_clock() -> None:
    desk = Desk()
    desk.arm()
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
