"""Commands on a machine with all fields set by the test: each condition separately."""

from math import pi

from robot.core import modes, reasons, states
from robot.core import modes as machines
from robot.core.modes import Machine
from robot.core.motion import Trail, drop_crumb
from robot.core.parameters import DEFAULTS
from robot.core.safety.fence import Fence
from robot.core.values import Goal, Pose
from tests.support.each import each
from tests.support.robot.core.driving import AHEAD

ORIGIN = Pose(0.0, 0.0, 0.0)
ELSEWHERE = Fence((10.0,), (0.0,), 1.0)


def machine(vehicle: int = states.ACTIVE) -> Machine:
    """Return a machine with sensor data, without operator, failsafe cause and goal."""
    made = Machine(DEFAULTS)
    made.vehicle, made.senses = vehicle, True
    return made


def trail(*crumbs_m: tuple[float, float]) -> Trail:
    made = Trail()
    for x_m, y_m in crumbs_m:
        drop_crumb(made, x_m, y_m)
    return made


WAY = trail((1.0, -2.0), (1.5, -2.5), (2.0, -3.0))


def test_arming_needs_a_robot_that_has_booted() -> None:
    booting = machine(states.BOOT)
    assert modes.arm(booting) == reasons.NO_SENSES
    assert booting.vehicle == states.BOOT


def test_arming_needs_senses_in_this_moment() -> None:
    blind = machine(states.STANDBY)
    blind.senses = False
    assert modes.arm(blind) == reasons.NO_SENSES


@each("vehicle", [states.STANDBY, states.FAILSAFE])
def test_arming_is_refused_with_the_failsafe_that_would_trip(vehicle: int) -> None:
    tripped = machine(vehicle)
    tripped.cause = reasons.FENCE_BREACHED
    assert modes.arm(tripped) == reasons.FENCE_BREACHED
    assert tripped.vehicle == vehicle


def test_arming_an_armed_robot_changes_nothing() -> None:
    armed = machine(states.ACTIVE)
    armed.cause, armed.vehicle_reason = reasons.BUMPER, reasons.BY_OPERATOR
    assert modes.arm(armed) == reasons.OK, "the failsafe decides, in this tick"
    assert (armed.vehicle, armed.vehicle_reason) == (states.ACTIVE, reasons.BY_OPERATOR)


def test_way_back_leads_to_the_start_without_an_operator() -> None:
    away = machine()
    assert modes.rtl(away, WAY, 1_000) == reasons.OK
    assert away.mode == states.SMART_RTL
    assert away.goal == Goal(1.0, -2.0, None, 0.05, pi)
    assert (away.goal_state, away.goal_started_ms) == (states.ACCEPTED, 1_000)


def test_the_way_back_stays_inside_the_fence() -> None:
    away = machine()
    away.fence = Fence((1.5,), (-2.5,), 1.0)
    assert modes.rtl(away, WAY, 0) == reasons.OK
    away.fence = Fence((2.0,), (-3.0,), 1.0)
    assert modes.rtl(away, WAY, 0) == reasons.OUTSIDE_FENCE


def test_auto_may_be_chosen_without_an_operator() -> None:
    alone = machine()
    assert modes.set_mode(alone, WAY, states.AUTO, 0) == reasons.OK
    assert alone.mode == states.AUTO


def test_leaving_the_way_back_ends_its_goal() -> None:
    away = machine()
    modes.rtl(away, WAY, 0)
    assert modes.set_mode(away, WAY, states.AUTO, 2_000) == reasons.OK
    assert (away.goal_state, away.goal_reason) == (states.ABORTED, reasons.BY_OPERATOR)
    assert away.goal_ended_ms == 2_000


def test_another_driving_mode_keeps_the_goal() -> None:
    on_its_way = machine()
    machines.start_goal(on_its_way, AHEAD, states.GUIDED, 0)
    assert modes.set_mode(on_its_way, WAY, states.AUTO, 0) == reasons.OK
    assert machines.goal_is_active(on_its_way)


def test_fence_without_the_robot_is_accepted_only_in_boot() -> None:
    assert modes.set_fence(machine(states.BOOT), ELSEWHERE, ORIGIN) == reasons.OK
    for vehicle in (states.STANDBY, states.ACTIVE, states.FAILSAFE, states.EMERGENCY_STOP):
        refused = machine(vehicle)
        assert modes.set_fence(refused, ELSEWHERE, ORIGIN) == reasons.FENCE_LEAVES_ROBOT_OUT
        assert refused.fence is None


@each(
    ("navigator", "side", "pursuits"),
    [
        (states.BUG, states.LEFT, 0),
        (states.BUG, states.RIGHT, 1),
        (states.VGM, states.LEFT, 1),
        (states.VGM, states.RIGHT, 1),
    ],
)
def test_another_navigator_or_side_begins_afresh_once(
    navigator: int, side: int, pursuits: int
) -> None:
    chosen = machine()
    chosen.navigator, chosen.side = states.BUG, states.LEFT
    assert modes.set_navigator(chosen, navigator, side) == reasons.OK
    assert (chosen.navigator, chosen.side, chosen.pursuits) == (navigator, side, pursuits)


@each("tolerance_rad", [0.2 * pi / 180.0 - 1.2e-6, pi + 1.2e-6])
def test_heading_tolerance_may_be_off_by_one_wire_unit(tolerance_rad: float) -> None:
    goal = AHEAD._replace(heading_tolerance_rad=tolerance_rad)
    assert modes.goto(machine(), goal, states.AUTO, 0) == reasons.TOLERANCE_OUT_OF_RANGE
