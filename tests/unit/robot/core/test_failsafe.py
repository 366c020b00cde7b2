import re
from math import hypot, inf, nan

import pytest

from ground.client.vocabulary import HINTS
from robot.core import limits, modes, reasons, states
from robot.core.parameters import DEFAULTS, Params
from robot.core.perception.odometry import JUMP_SLACK_M
from robot.core.perception.sonar_ring import BEYOND
from robot.core.safety import failsafe
from robot.core.safety.fence import Fence
from robot.core.values import Goal, Inputs, Pose, Scan, Twist, Wheels
from robot.process import OVERRUNS_IN_A_ROW
from tests.support.cores import OPEN_SPACE, Driven, armed, driving
from tests.support.each import each

MODES = (states.MANUAL, states.HOLD, states.AUTO, states.SMART_RTL, states.GUIDED)

AGES = (25, 0) * 4


def stopped_by(driven: Driven, reason: int, within_ticks: int = 1) -> None:
    """Check that the robot stops with this reason within this many ticks, and its goal ends."""
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


def test_limits_of_rows_name_parameters_and_times_that_exist() -> None:
    for row in failsafe.ROWS:
        names = set(re.findall(r"\b\w+_\w+\b", row.limit))
        assert names <= {*Params._fields, *vars(limits)}, row.limit
    by_reason = {row.reason: row.limit for row in failsafe.ROWS}
    assert by_reason[reasons.TICKS_LOST].startswith("TICKS_LOST_MS, ")
    assert by_reason[reasons.SCAN_LOST].startswith("SCAN_LOST_MS, ")
    slack_mm = round(JUMP_SLACK_M * 1000)
    assert by_reason[reasons.ENCODER_IMPOSSIBLE] == f"twice wheel_max_m_s + {slack_mm} mm"
    assert by_reason[reasons.SONAR_IMPOSSIBLE] == f"0 or beyond {BEYOND} sonar_max_m"
    assert by_reason[reasons.BUDGET].startswith(f"{OVERRUNS_IN_A_ROW} overruns in a row, ")


def test_the_first_of_several_causes_is_the_one_that_is_named() -> None:
    driven = driving()
    driven.has_wheels, driven.scan = False, None
    stopped_by(driven, reasons.TICKS_LOST)
    assert driven.machine.cause == reasons.TICKS_LOST


def test_what_the_host_has_reported_counts_for_one_tick() -> None:
    driven = driving()
    driven.state.reported = reasons.BUDGET
    driven.tick()
    assert driven.state.reported == reasons.OK


def test_lost_ticks_stop_the_robot_in_the_tick_they_are_missed() -> None:
    driven = driving()
    driven.has_wheels = False
    stopped_by(driven, reasons.TICKS_LOST)


def test_a_lost_scan_stops_the_robot_in_the_tick_it_is_missed() -> None:
    driven = driving()
    driven.scan = None
    stopped_by(driven, reasons.SCAN_LOST)


def test_ring_without_measurements_is_lost_once_stale() -> None:
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


def test_jammed_wheel_stops_the_robot_in_half_a_second() -> None:
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


def test_auto_and_idle_guided_need_no_operator() -> None:
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


def sound_inputs(driven: Driven) -> Inputs:
    return Inputs(driven.now_ms, Wheels(0, 0, 0, driven.now_ms), driven.scan, 0)


COVARIANCES = ("pxx", "pxy", "pxh", "pyy", "pyh", "phh")


@each("value", [nan, inf, -inf])
@each("at", range(3))
def test_a_pose_that_is_not_finite_stops_the_robot(at: int, value: float) -> None:
    driven = driving()
    pose = list(driven.state.odometry.pose)
    pose[at] = value
    driven.state.odometry.pose = Pose(*pose)
    failsafe.check(driven.state, sound_inputs(driven), DEFAULTS)
    assert driven.machine.vehicle_reason == reasons.NOT_FINITE


@each("value", [nan, inf, -inf])
@each("name", COVARIANCES)
def test_a_covariance_that_is_not_finite_stops_the_robot(name: str, value: float) -> None:
    driven = driving()
    setattr(driven.state.odometry, name, value)
    stopped_by(driven, reasons.NOT_FINITE)


@each("twist", [Twist(nan, 0.0), Twist(0.0, nan), Twist(inf, 0.0)])
def test_a_twist_that_is_not_finite_stops_the_robot(twist: Twist) -> None:
    driven = driving()
    driven.state.twist = twist
    stopped_by(driven, reasons.NOT_FINITE)


def test_infinities_of_opposite_sign_do_not_cancel() -> None:
    driven = driving()
    driven.state.odometry.pxx, driven.state.odometry.pyy = inf, -inf
    stopped_by(driven, reasons.NOT_FINITE)


def test_controller_with_nan_moves_no_wheel_and_is_stopped() -> None:
    driven = driving()
    driven.params = DEFAULTS._replace(k_omega=nan)
    driven.tick()
    assert driven.stands
    stopped_by(driven, reasons.NOT_FINITE)


@each("reason", [reasons.BUDGET, reasons.CORE_EXCEPTION, reasons.NAME_TAKEN])
def test_reasons_reported_by_the_host_stop_the_robot(reason: int) -> None:
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


def test_disarmed_robot_has_no_failsafe() -> None:
    driven = Driven()
    driven.tick()
    driven.scan = None
    driven.forward(1.0)
    assert driven.machine.vehicle == states.STANDBY


SQUARE = Fence((-1.0, 1.0, 1.0, -1.0), (-1.0, -1.0, 1.0, 1.0), 0.0)
CIRCLE = Fence((0.0,), (0.0,), 1.0)
fences_of_a_metre = pytest.mark.parametrize("fence", [SQUARE, CIRCLE], ids=["polygon", "circle"])


def at(x_m: float, y_m: float, fence: Fence | None) -> Driven:
    """Arm at a place, then set a fence without its check."""
    driven = armed()
    driven.state.odometry.pose = Pose(x_m, y_m, 0.0)
    driven.machine.fence = fence
    return driven


@fences_of_a_metre
@pytest.mark.parametrize("place_m", [(0.0, 0.0), (0.9, 0.0), (0.0, -0.9), (1.0, 0.0)])
def test_a_robot_within_its_fence_stays_active(fence: Fence, place_m: tuple[float, float]) -> None:
    driven = at(*place_m, fence)
    for _ in range(3):
        driven.tick()
        assert (driven.machine.vehicle, driven.machine.cause) == (states.ACTIVE, reasons.OK)


@fences_of_a_metre
@pytest.mark.parametrize("place_m", [(1.1, 0.0), (0.0, -1.1), (-50.0, 0.0), (1.001, 0.0)])
def test_a_robot_outside_its_fence_stops_in_that_tick(
    fence: Fence, place_m: tuple[float, float]
) -> None:
    driven = at(*place_m, fence)
    assert driven.machine.vehicle == states.ACTIVE
    driven.tick()
    machine = driven.machine
    assert (machine.vehicle, machine.vehicle_reason) == (states.FAILSAFE, reasons.FENCE_BREACHED)
    assert machine.cause == reasons.FENCE_BREACHED


def test_without_a_fence_no_place_is_outside() -> None:
    driven = at(90.0, -90.0, None)
    driven.tick()
    assert (driven.machine.vehicle, driven.machine.cause) == (states.ACTIVE, reasons.OK)


def away_m(pose: Pose) -> float:
    return hypot(pose.x_m, pose.y_m)


def test_leaving_the_fence_stops_the_robot_until_it_is_removed() -> None:
    driven = driving()
    start_m = away_m(driven.state.odometry.pose)
    driven.machine.fence = Fence((0.0,), (0.0,), 0.5)
    inside_m: list[float] = []
    while driven.machine.vehicle == states.ACTIVE:
        assert len(inside_m) < 60
        inside_m.append(away_m(driven.state.odometry.pose))
        driven.tick()
    assert inside_m[0] == start_m
    assert start_m < 0.2
    assert inside_m[-1] == pytest.approx(0.5, abs=0.02), "it drove up to the fence"
    assert max(inside_m) <= 0.5 < away_m(driven.state.odometry.pose)
    stopped_by(driven, reasons.FENCE_BREACHED, within_ticks=0)
    driven.tick()
    assert modes.arm(driven.machine) == reasons.FENCE_BREACHED
    assert modes.set_fence(driven.machine, None, driven.state.odometry.pose) == reasons.OK
    driven.tick()
    assert modes.arm(driven.machine) == reasons.OK


def follow(driven: Driven, remedy: str) -> int:
    """Do what a remedy says, literally, and return the reason."""
    machine = driven.machine
    if remedy == "sidestep arm":
        return modes.arm(machine)
    if remedy == "sidestep fence off":
        return modes.set_fence(machine, None, driven.state.odometry.pose)
    assert remedy == "sidestep pose set X Y DEG"
    machine.placed = True
    return reasons.OK


@each("attended", [False, True])
@each("mode", MODES)
@each("reason", [row.reason for row in failsafe.ROWS])
def test_the_printed_remedies_lead_on_after_a_failsafe(
    reason: int, mode: int, attended: bool
) -> None:
    driven = armed()
    driven.machine.mode = mode
    if reason in (reasons.FENCE_BREACHED, reasons.FENCE_UNCHECKED):
        driven.machine.fence = Fence((0.0,), (0.0,), 0.5)
        driven.machine.placed = reason == reasons.FENCE_BREACHED
        driven.state.odometry.pose = Pose(0.9 * driven.machine.placed, 0.0, 0.0)
    failsafe.trip(driven.machine, reason, driven.now_ms)
    driven.operator_age_ms = 0 if attended else None
    driven.tick()
    refusal = follow(driven, "sidestep arm")
    if refusal != reasons.OK:
        assert refusal == reason, "what is named is what stops it"
        assert follow(driven, HINTS[refusal]) == reasons.OK
        driven.tick()
        assert follow(driven, "sidestep arm") == reasons.OK
    driven.forward(1.0)
    assert driven.machine.vehicle == states.ACTIVE
    assert (driven.machine.mode == mode) == (attended or mode != states.MANUAL)
    assert driven.goto(Goal(0.3, 0.0, None, 0.05, 0.05)) == reasons.OK
    driven.forward(0.5)
    assert not driven.stands
