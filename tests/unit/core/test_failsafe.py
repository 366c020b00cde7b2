from math import nan

import pytest

from robot.core import failsafe, modes, reasons, states
from robot.core.fence import Fence
from robot.core.parameters import DEFAULTS
from robot.core.values import Pose, Scan, Twist
from tests.unit.core.driving import OPEN_SPACE, Driven, armed, driving

AGES = (25, 0) * 4


def stopped_by(driven: Driven, reason: int, within_ticks: int = 1) -> None:
    """The robot stops with this reason within so many ticks, and its goal ends with it."""
    for _ in range(within_ticks):
        driven.tick()
        if driven.machine.vehicle == states.FAILSAFE:
            break
    machine = driven.machine
    assert (machine.vehicle, machine.vehicle_reason) == (states.FAILSAFE, reason)
    assert (machine.goal_state, machine.goal_reason) == (states.ABORTED, reason)
    assert driven.stands


def test_every_failsafe_reason_has_one_row() -> None:
    failsafes = {
        value for name, value in vars(reasons).items() if name.isupper() and 30 <= value < 60
    }
    assert sorted(row.reason for row in failsafe.ROWS) == sorted(failsafes)


def test_lost_ticks_stop_the_robot_in_the_tick_they_are_missed() -> None:
    driven = driving()
    driven.has_wheels = False
    stopped_by(driven, reasons.TICKS_LOST)


def test_a_lost_scan_stops_the_robot_in_the_tick_it_is_missed() -> None:
    driven = driving()
    driven.scan = None
    stopped_by(driven, reasons.SCAN_LOST)


def test_a_ring_in_which_no_sonar_measures_is_lost_after_its_last_ping_is_stale() -> None:
    driven = driving()
    driven.scan = Scan((0,) * 8, AGES, 0, 0)
    driven.forward(0.1)
    assert driven.machine.vehicle == states.ACTIVE
    stopped_by(driven, reasons.SCAN_LOST, within_ticks=3)


def test_an_impossible_echo_stops_the_robot() -> None:
    driven = driving()
    driven.scan = Scan((0,) * 8, AGES, 0xFF, 1)
    stopped_by(driven, reasons.SONAR_IMPOSSIBLE)


def test_a_frozen_ring_stops_the_robot_before_it_gets_there() -> None:
    driven = driving()
    driven.scan = Scan((0, 0, 0, 350, 0, 0, 0, 0), AGES, 0xFF, 1 << 3)
    stopped_by(driven, reasons.SONAR_FROZEN, within_ticks=30)
    assert modes.arm(driven.machine) == reasons.SONAR_FROZEN
    driven.scan = OPEN_SPACE
    driven.tick()
    assert modes.arm(driven.machine) == reasons.OK


def test_a_jumping_encoder_stops_the_robot() -> None:
    driven = driving()
    driven.left += 10_000
    stopped_by(driven, reasons.ENCODER_IMPOSSIBLE)


def test_a_jammed_wheel_stops_the_robot_in_little_more_than_half_a_second() -> None:
    driven = driving()
    driven.jammed = True
    stopped_by(driven, reasons.WHEEL_STUCK, within_ticks=22)


def test_a_wheel_jammed_from_the_start_is_found_too() -> None:
    driven = armed()
    driven.jammed = True
    driven.goto()
    stopped_by(driven, reasons.WHEEL_STUCK, within_ticks=14)


def test_contact_stops_the_robot_once_and_it_may_be_armed_again() -> None:
    driven = driving()
    driven.bumper = 2
    stopped_by(driven, reasons.BUMPER)
    driven.tick()
    assert modes.arm(driven.machine) == reasons.OK
    driven.tick()
    assert driven.machine.vehicle == states.ACTIVE


def test_a_lost_operator_stops_guided_after_a_second_and_a_half() -> None:
    driven = driving(states.GUIDED)
    driven.operator_age_ms = DEFAULTS.op_lost_ms
    driven.tick()
    assert driven.machine.vehicle == states.ACTIVE
    driven.operator_age_ms = DEFAULTS.op_lost_ms + 1
    stopped_by(driven, reasons.OPERATOR_LOST)


def test_auto_goes_on_without_an_operator_and_so_does_a_guided_robot_without_a_goal() -> None:
    driven = driving(states.AUTO)
    driven.operator_age_ms = None
    driven.forward(1.0)
    assert driven.machine.vehicle == states.ACTIVE
    driven = driving(states.GUIDED)
    modes.abort(driven.machine, driven.now_ms)
    driven.operator_age_ms = None
    driven.forward(1.0)
    assert driven.machine.vehicle == states.ACTIVE


def test_manual_needs_its_operator_all_the_time() -> None:
    driven = armed()
    modes.set_mode(driven.machine, driven.state.trail, states.MANUAL, 0)
    driven.operator_age_ms = 2_000
    driven.tick()
    assert driven.machine.vehicle_reason == reasons.OPERATOR_LOST


@pytest.mark.parametrize("where", ["pose", "covariance", "twist"])
def test_what_is_not_a_number_stops_the_robot(where: str) -> None:
    driven = driving()
    if where == "pose":
        driven.state.odometry.pose = Pose(nan, 0.0, 0.0)
    elif where == "covariance":
        driven.state.odometry.phh = nan
    else:
        driven.state.twist = Twist(nan, 0.0)
    stopped_by(driven, reasons.NOT_FINITE)


def test_a_controller_that_goes_mad_moves_no_wheel_and_is_stopped() -> None:
    driven = driving()
    driven.params = DEFAULTS._replace(k_omega=nan)
    driven.tick()
    assert driven.stands
    stopped_by(driven, reasons.NOT_FINITE)


@pytest.mark.parametrize("reason", [reasons.BUDGET, reasons.CORE_EXCEPTION])
def test_what_only_the_host_can_see_stops_the_robot_too(reason: int) -> None:
    driven = driving()
    driven.state.reported = reason
    stopped_by(driven, reason)
    driven.tick()
    assert modes.arm(driven.machine) == reasons.OK


def test_arming_is_refused_while_the_cause_is_there() -> None:
    driven = driving()
    driven.scan = None
    stopped_by(driven, reasons.SCAN_LOST)
    assert modes.arm(driven.machine) == reasons.NO_SENSES
    driven.scan = OPEN_SPACE
    driven.tick()
    assert driven.machine.vehicle == states.FAILSAFE
    assert modes.arm(driven.machine) == reasons.OK
    assert driven.machine.vehicle == states.ACTIVE


def test_a_failsafe_does_not_loosen_an_emergency_stop() -> None:
    driven = driving()
    modes.estop(driven.machine, driven.now_ms)
    failsafe.trip(driven.machine, reasons.CORE_EXCEPTION, driven.now_ms)
    assert driven.machine.vehicle == states.EMERGENCY_STOP


def test_a_standing_disarmed_robot_has_no_failsafe() -> None:
    driven = Driven()
    driven.tick()
    driven.scan = None
    driven.forward(1.0)
    assert driven.machine.vehicle == states.STANDBY


def test_a_robot_that_leaves_its_fence_stops_and_cannot_be_armed_until_it_is_lifted() -> None:
    driven = driving()
    driven.machine.fence = Fence((0.0,), (0.0,), 0.5)
    for _ in range(60):
        driven.tick()
        if driven.machine.vehicle != states.ACTIVE:
            break
        assert driven.state.odometry.pose.x_m <= 0.5
    stopped_by(driven, reasons.FENCE_BREACHED, within_ticks=0)
    driven.tick()
    assert modes.arm(driven.machine) == reasons.FENCE_BREACHED
    assert modes.set_fence(driven.machine, None, driven.state.odometry.pose) == reasons.OK
    driven.tick()
    assert modes.arm(driven.machine) == reasons.OK
