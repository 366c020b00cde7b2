"""Every row of the failsafe table, lost operators, killed processes, and bad links."""

from collections.abc import Callable
from dataclasses import dataclass
from math import nan

import pytest

from checks.faults.bus_observer import second_robot
from checks.faults.cases import FAULTS
from checks.faults.simulated_time import BreakableInProcess
from checks.harness.in_process import InProcess
from checks.harness.until import until
from protocol.bus.link_faults import LinkFaults
from protocol.wire.enums import Command, GoalState, LeaseAction, Mode, Vehicle
from protocol.wire.reasons import Reason
from robot.core.safety import failsafe
from robot.core.safety.fence import Fence
from robot.core.values import Pose
from runtime.clock import ManualClock
from runtime.units import NS_PER_MS as MS_NS
from runtime.units import PERIOD_NS
from tests.support.each import each
from tests.support.stacks import STOPPING_S, Operator


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


def break_core(stack: InProcess) -> None:
    assert isinstance(stack, BreakableInProcess)
    stack.break_core()


def lose_time(stack: InProcess) -> None:
    stack.hanging = frozenset({"robot"})
    stack.forward(0.15)
    stack.hanging = frozenset()


def lose_operator(stack: InProcess) -> None:
    stack.operator = False


def spoil_pose(stack: InProcess) -> None:
    stack.vehicle.state.odometry.pose = Pose(nan, 1.0, 0.0)


def leave_fence(stack: InProcess) -> None:
    pose = stack.vehicle.state.odometry.pose
    stack.vehicle.state.machine.fence = Fence((pose.x_m,), (pose.y_m,), 0.1)


def lose_place(stack: InProcess) -> None:
    machine, pose = stack.vehicle.state.machine, stack.vehicle.state.odometry.pose
    machine.fence, machine.placed = Fence((pose.x_m,), (pose.y_m,), 1e3), False


CAUSES: dict[Reason, tuple[Callable[[InProcess], object], float]] = {
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
    with BreakableInProcess("corridor", noise="default", enforced=True) as stack:
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
    with InProcess("corridor", noise="default") as stack:
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
    with InProcess("open") as stack:
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
    with InProcess("open") as stack:
        second = second_robot(stack)
        stack.forward(0.05)
        assert stack.arm() == Reason.NAME_TAKEN
        second.close()
        gone = stack.buses["robot"].present
        until(lambda: second.zid not in {who.zid for who in gone()}, what="the second is gone")
        stack.forward(0.05)
        assert stack.arm() == Reason.NONE


def test_guided_stops_without_its_operator_and_auto_goes_on() -> None:
    with InProcess("open") as stack:
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
    with InProcess("corridor", noise="harsh", navigator="bug") as stack:
        stack.arm()
        stack.goto_goal()
        stack.forward(20.0)
        assert stack.state in (Vehicle.ACTIVE, Vehicle.FAILSAFE)
        assert stack.why in (Reason.NONE, Reason.BUMPER)


def test_emergency_stop_ends_within_two_periods_and_braking() -> None:
    """Motors are short-circuited: a ramp and their lag alone would take 0.35 s."""
    with InProcess("corridor", noise="default") as stack:
        stack.arm()
        stack.goto_goal()
        stack.until(stack.driving)
        stack.command(Command.DO_FLIGHTTERMINATION)
        assert stack.until(stack.standing, within_s=2.0) <= 0.15 + 1e-9
        stack.forward(0.5)
        assert stack.standing()


PERIOD_S = 0.05


def by_hand(stack: InProcess) -> Operator:
    """Return an armed robot in MANUAL, driven straight ahead at full speed."""
    operator = Operator(stack, "ada")
    stack.arm()
    operator.beat()
    stack.forward(PERIOD_S)
    assert operator.manual() == Reason.NONE
    for _ in range(10):
        operator.beat()
        operator.steer(0.3)
        stack.forward(0.1)
    assert stack.driving()
    return operator


def told_to_stand(stack: InProcess) -> bool:
    return stack.vehicle.state.twist == (0.0, 0.0)


@each("ttl_ms", [100, 300, 500])
def test_robot_stops_soon_after_the_last_frame(ttl_ms: int) -> None:
    with InProcess("open") as stack:
        operator = by_hand(stack)
        operator.steer(0.3, ttl_ms=ttl_ms)
        told_s = stack.until(lambda: told_to_stand(stack), within_s=2.0)
        assert told_s <= ttl_ms / 1000 + 2 * PERIOD_S + 1e-9
        assert told_s >= ttl_ms / 1000, "not before its time"
        assert stack.until(stack.standing, within_s=2.0) <= STOPPING_S
        assert stack.state == Vehicle.ACTIVE, "the next frame may drive on"
        operator.beat()
        operator.steer(0.0, 0.5)
        stack.forward(0.2)
        assert stack.truth.yaw_rate_rad_s > 0.1


def test_lost_operator_stops_the_robot() -> None:
    with InProcess("open") as stack:
        by_hand(stack)
        stack.kill("ground")
        assert stack.until(lambda: told_to_stand(stack), within_s=2.0) <= 0.3 + 2 * PERIOD_S


def test_frame_with_too_long_ttl_is_ignored_and_announced() -> None:
    with InProcess("open") as stack:
        operator = Operator(stack, "ada")
        stack.arm()
        operator.manual()
        for _ in range(5):
            operator.steer(0.3, ttl_ms=501)
            stack.forward(0.1)
        assert stack.standing()
        stack.until(lambda: any("teleop ignored" in text for text in stack.texts), within_s=2.0)


def test_frames_drive_in_manual_only() -> None:
    with InProcess("open") as stack:
        operator = Operator(stack, "ada")
        stack.arm()
        for _ in range(5):
            operator.steer(0.3)
            stack.forward(0.1)
        assert stack.standing()


def test_only_the_holder_of_the_lease_steers() -> None:
    with InProcess("open") as stack:
        ada, bob = Operator(stack, "ada"), Operator(stack, "bob")
        assert ada.lease(LeaseAction.TAKE) == Reason.NONE
        ada.beat()
        stack.forward(0.1)
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        assert bob.manual() == Reason.LEASE_HELD
        assert ada.manual() == Reason.NONE
        for _ in range(5):
            bob.steer(0.3)
            stack.forward(0.1)
        assert stack.standing()
        for _ in range(5):
            ada.beat()
            ada.steer(0.3)
            bob.steer(-0.3)
            stack.forward(0.1)
        assert stack.driving()
        assert stack.status.mode == Mode.MANUAL


def test_teleop_does_not_hit_a_wall() -> None:
    with InProcess("box") as stack:
        operator = Operator(stack, "ada")
        stack.arm()
        operator.manual()
        for _ in range(300):
            operator.steer(0.3)
            stack.forward(0.1)
        assert stack.standing()
        assert stack.truth.clearance_m > 0.0
        assert stack.truth.contact == 0


def driving_stack(stack: InProcess, mode: Mode = Mode.GUIDED) -> None:
    stack.arm()
    stack.goto_goal(mode)
    stack.until(stack.driving)


def test_wheels_stop_within_200_ms_of_the_robots_death() -> None:
    with InProcess("open") as stack:
        driving_stack(stack)
        stack.kill("robot")
        took_s = stack.until(stack.standing, within_s=1.0)
        assert took_s <= 0.2 + 1e-9


def test_restarted_robot_is_disarmed_with_a_text() -> None:
    with InProcess("open") as stack:
        driving_stack(stack)
        stack.kill("robot")
        stack.forward(1.0)
        stack.start("robot")
        stack.reconnect()
        stack.forward(1.0)
        assert stack.standing()
        assert stack.state == Vehicle.STANDBY
        assert stack.goal_state == GoalState.NONE
        assert "started: disarmed, standing still" in stack.texts


def test_without_a_plant_the_robot_stops_with_its_reason() -> None:
    with InProcess("open") as stack:
        driving_stack(stack)
        stack.kill("plant")
        noticed_s = stack.until(lambda: stack.state == Vehicle.FAILSAFE, within_s=1.0)
        assert noticed_s <= 0.25 + 1e-9
        assert stack.why == Reason.TICKS_LOST
        stack.forward(0.1)
        assert stack.status.vehicle_reason == Reason.TICKS_LOST


def test_without_the_ground_station_guided_stops() -> None:
    with InProcess("open") as stack:
        driving_stack(stack, Mode.GUIDED)
        stack.kill("ground")
        stack.until(lambda: stack.state == Vehicle.FAILSAFE, within_s=2.0)
        assert stack.why == Reason.OPERATOR_LOST
        stack.until(stack.standing, within_s=1.0)


def test_without_the_ground_station_auto_reaches_its_goal() -> None:
    with InProcess("open") as stack:
        driving_stack(stack, Mode.AUTO)
        stack.kill("ground")
        stack.until(stack.reached)


def under_way(stack: InProcess) -> None:
    stack.forward(0.5)
    stack.arm()
    stack.goto_goal()
    stack.until(stack.driving)


@pytest.mark.sweep(2)
@pytest.mark.parametrize(
    "trouble",
    [
        LinkFaults(loss=0.05),
        LinkFaults(loss=0.01),
        LinkFaults(reorder=0.3),
        LinkFaults(duplicate=0.3),
        LinkFaults(delay_ms=50),
    ],
    ids=["5 % lost", "1 % lost", "30 % swapped", "30 % doubled", "50 ms late"],
)
def test_a_slightly_bad_link_does_not_keep_it_from_its_goal(trouble: LinkFaults) -> None:
    with InProcess("box", noise="default") as stack:
        under_way(stack)
        for name in ("robot", "plant"):
            stack.buses[name].faults.disturb(trouble)
        stack.until(stack.reached)
        stack.assert_near(5.4, 2.0, within_m=0.2)
        assert stack.truth.contact == 0


@each("delay_ms", [300, 500])
def test_very_late_sensor_frames_count_as_lost(delay_ms: int) -> None:
    with InProcess("corridor", noise="default") as stack:
        under_way(stack)
        stack.buses["robot"].faults.disturb(LinkFaults(delay_ms=delay_ms, paths=("sense/",)))
        noticed_s = stack.until(lambda: stack.state == Vehicle.FAILSAFE, within_s=1.0)
        assert noticed_s <= 0.25 + 1e-9
        assert stack.why == Reason.TICKS_LOST
        stack.forward(STOPPING_S)
        assert stack.standing()


def test_reordered_scan_does_not_replace_a_newer_one() -> None:
    with InProcess("open") as stack:
        under_way(stack)
        stack.buses["robot"].faults.disturb(LinkFaults(jitter_ms=140, paths=("sense/",)))
        stack.forward(0.05)
        heard = []
        for _ in range(60):
            stack.forward(0.05)
            heard.append(stack.senses_used)
        assert heard == sorted(heard), "it never goes back to what it knew before"


def test_late_or_repeated_commands_do_not_keep_wheels_turning() -> None:
    with InProcess("open") as stack:
        under_way(stack)
        late = LinkFaults(delay_ms=100, duplicate=1.0, jitter_ms=100)
        stack.buses["plant"].faults.disturb(late)
        stack.forward(0.5)
        stack.kill("robot")
        assert stack.until(stack.standing, within_s=1.0) <= 0.2 + 1e-9


FULL_NS = {"milliseconds": (1 << 32) * MS_NS, "ticks": (1 << 32) * PERIOD_NS}
"""After 49.7 days, which are 10 hours of the fastest lockstep, and after 6.8 years."""


@each("what", FULL_NS)
def test_a_robot_drives_on_when_a_count_is_full(what: str) -> None:
    stack = InProcess("open")
    stack.clock = ManualClock(FULL_NS[what] // PERIOD_NS * PERIOD_NS - 60 * PERIOD_NS)
    with stack:
        stack.arm()
        stack.goto_goal()
        stack.until(stack.driving, within_s=3.0)
        stack.forward(3.0)
        assert stack.clock.now_ns() > FULL_NS[what]
        stack.until(stack.reached, within_s=60.0)
        stack.assert_near(stack.world.goal.x_m, stack.world.goal.y_m)
