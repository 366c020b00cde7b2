"""Every row of the failsafe table over the whole stack: stop, reason and time."""

from collections.abc import Callable
from dataclasses import dataclass
from math import nan

from checks.faults.cases import FAULTS
from checks.faults.intruders import second_robot
from checks.faults.simulated_time import BreakableInProcess
from protocol.wire.enums import Command, GoalState, Mode, Vehicle
from protocol.wire.reasons import Reason
from robot.core.safety import failsafe
from robot.core.safety.fence import Fence
from robot.core.values import Pose
from tests.support.each import each
from tests.support.harness import STOPPING_S, Stack
from tests.support.until import until


@dataclass(frozen=True)
class Row:
    """A fault, its reason, and the time limit for its detection."""

    kind: str
    target: str
    value: float
    reason: Reason
    limit_s: float


ROWS = [
    Row("ticks_stopped", "", 0.0, Reason.TICKS_LOST, 0.25),
    Row("scan_stopped", "", 0.0, Reason.SCAN_LOST, 0.35),
    Row("encoder_stuck", "both", 0.0, Reason.WHEEL_STUCK, 1.05),
    Row("encoder_stuck", "left", 0.0, Reason.WHEEL_STUCK, 1.05),
    Row("encoder_jump", "left", 50_000.0, Reason.ENCODER_IMPOSSIBLE, 0.10),
    Row("wheel_stuck", "both", 0.0, Reason.WHEEL_STUCK, 1.05),
    Row("sonar_frozen", "all", 0.0, Reason.SONAR_FROZEN, 2.0),
    Row("sonar_fixed", "3", 9.0, Reason.SONAR_IMPOSSIBLE, 0.10),
    Row("bumper_stuck", "", 1.0, Reason.BUMPER, 0.10),
]


def break_core(stack: Stack) -> None:
    assert isinstance(stack, BreakableStack)
    stack.break_core()


def lose_time(stack: Stack) -> None:
    stack.hanging = frozenset({"robot"})
    stack.forward(0.15)
    stack.hanging = frozenset()


def lose_operator(stack: Stack) -> None:
    stack.operator = False


def spoil_pose(stack: Stack) -> None:
    stack.vehicle.state.odometry.pose = Pose(nan, 1.0, 0.0)


def leave_fence(stack: Stack) -> None:
    pose = stack.vehicle.state.odometry.pose
    stack.vehicle.state.machine.fence = Fence((pose.x_m,), (pose.y_m,), 0.1)


def lose_place(stack: Stack) -> None:
    machine, pose = stack.vehicle.state.machine, stack.vehicle.state.odometry.pose
    machine.fence, machine.placed = Fence((pose.x_m,), (pose.y_m,), 1e3), False


class BreakableStack(Stack, BreakableInProcess):
    """A stack with faults that a world file cannot describe."""


CAUSES: dict[Reason, tuple[Callable[[Stack], object], float]] = {
    Reason.CORE_EXCEPTION: (break_core, 0.05),
    Reason.BUDGET: (lose_time, 0.05),
    Reason.NOT_FINITE: (spoil_pose, 0.05),
    Reason.OPERATOR_LOST: (lose_operator, 1.65),
    Reason.NAME_TAKEN: (second_robot, 0.05),
    Reason.FENCE_BREACHED: (leave_fence, 0.45),
    Reason.FENCE_UNCHECKED: (lose_place, 0.05),
}
"""The triggers of rows without a fault in the plant, and the time limit of their detection."""


@each("reason", CAUSES)
def test_faults_of_the_robot_process_stop_it(reason: Reason) -> None:
    with BreakableStack("corridor", noise="default", enforced=True) as stack:
        stack.arm()
        stack.goto_goal()
        stack.until(stack.driving)
        cause, limit_s = CAUSES[reason]
        cause(stack)
        noticed_s = stack.until(lambda: stack.state == Vehicle.FAILSAFE, within_s=5.0)
        assert stack.why == reason
        assert noticed_s <= limit_s + 1e-9
        assert stack.goal_state == GoalState.ABORTED
        stack.forward(STOPPING_S)
        assert stack.standing()


def test_every_row_of_the_failsafe_table_is_tested_here() -> None:
    tested = {row.reason for row in ROWS} | set(CAUSES)
    assert {Reason(row.reason) for row in failsafe.ROWS} == tested


def test_all_rows_but_three_are_in_the_fault_matrix() -> None:
    rows = {Reason(row.reason) for row in failsafe.ROWS}
    measured = {reason for fault in FAULTS for reason in fault.reasons}
    fence = {Reason.FENCE_BREACHED, Reason.FENCE_UNCHECKED}
    assert rows - measured == {Reason.NOT_FINITE} | fence


@each("row", ROWS)
def test_robot_stops_with_the_reason(row: Row) -> None:
    with Stack("corridor", noise="default") as stack:
        stack.forward(1.0)
        stack.arm()
        stack.goto_goal()
        stack.until(stack.driving)
        stack.forward(0.5)
        stack.inject(row.kind, row.target, row.value)
        noticed_s = stack.until(lambda: stack.state == Vehicle.FAILSAFE, within_s=5.0)
        assert stack.why == row.reason
        assert noticed_s <= row.limit_s + 1e-9
        assert stack.goal_state == GoalState.ABORTED
        stack.forward(STOPPING_S)
        assert stack.standing()
        stack.forward(0.1)
        assert stack.status.vehicle_reason == row.reason


def test_failsafe_holds_until_the_operator_arms_again() -> None:
    with Stack("open") as stack:
        stack.arm()
        stack.goto_goal()
        stack.until(stack.driving)
        stack.inject("scan_stopped")
        stack.until(lambda: stack.state == Vehicle.FAILSAFE)
        assert stack.arm() in (Reason.SCAN_LOST, Reason.NO_SENSES)
        stack.clear_faults()
        stack.forward(1.0)
        assert stack.state == Vehicle.FAILSAFE
        assert stack.standing()
        assert stack.arm() == Reason.NONE
        stack.goto_goal()
        stack.until(stack.reached)


def test_a_robot_is_not_armed_while_another_of_its_name_is_there() -> None:
    with Stack("open") as stack:
        second = second_robot(stack)
        stack.forward(0.05)
        assert stack.arm() == Reason.NAME_TAKEN
        second.close()
        gone = stack.buses["robot"].present
        until(lambda: second.zid not in {who.zid for who in gone()}, what="the second is gone")
        stack.forward(0.05)
        assert stack.arm() == Reason.NONE


def test_guided_stops_without_its_operator_and_auto_goes_on() -> None:
    with Stack("open") as stack:
        stack.arm()
        stack.goto_goal(Mode.GUIDED)
        stack.until(stack.driving)
        stack.operator = False
        noticed_s = stack.until(lambda: stack.state == Vehicle.FAILSAFE)
        assert stack.why == Reason.OPERATOR_LOST
        assert 1.3 <= noticed_s <= 1.65
        assert noticed_s + stack.until(stack.standing, within_s=2.0) <= 1.7 + 1e-9
        stack.operator = True
        stack.forward(0.5)
        stack.arm()
        stack.goto_goal(Mode.AUTO)
        stack.operator = False
        stack.until(stack.reached)


def test_noise_without_a_fault_trips_nothing() -> None:
    with Stack("corridor", noise="harsh", navigator="bug") as stack:
        stack.arm()
        stack.goto_goal()
        stack.forward(20.0)
        assert stack.state in (Vehicle.ACTIVE, Vehicle.FAILSAFE)
        assert stack.why in (Reason.NONE, Reason.BUMPER)


def test_emergency_stop_ends_within_two_periods_and_braking() -> None:
    """Motors are short-circuited: a ramp and their lag alone would take 0.35 s."""
    with Stack("corridor", noise="default") as stack:
        stack.arm()
        stack.goto_goal()
        stack.until(stack.driving)
        stack.command(Command.DO_FLIGHTTERMINATION)
        assert stack.until(stack.standing, within_s=2.0) <= 0.15 + 1e-9
        stack.forward(0.5)
        assert stack.standing()
