"""The failsafe table: one row for each condition that stops the robot."""

from typing import Final, NamedTuple, Protocol

from robot.core import modes, reasons, states
from robot.core.modes import Machine
from robot.core.parameters import Params
from robot.core.safety import fence as fences
from robot.core.state import State
from robot.core.values import Inputs


def ticks_lost(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger if wheel data are missing or stale."""
    return inputs.wheels is None


def scan_lost(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger without a scan, or if no sonar has measured for too long."""
    scan = inputs.scan
    return scan is None or (scan.valid == 0 and state.ring.fresh == 0)


def sonar_impossible(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger on a range that a sonar cannot measure."""
    return state.ring.impossible


def sonar_frozen(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger if the echoes do not follow the motion."""
    return state.frozen.verdict


def encoder_impossible(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger if a counter moved farther than a wheel can turn."""
    return state.odometry.jumped


def not_finite(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger on NaN or infinity in pose, covariance or twist; a sum keeps either."""
    odometry = state.odometry
    x_m, y_m, heading_rad = odometry.pose
    speed_m_s, yaw_rate_rad_s = state.twist
    total = x_m + y_m + heading_rad + speed_m_s + yaw_rate_rad_s
    total += odometry.pxx + odometry.pxy + odometry.pxh
    total += odometry.pyy + odometry.pyh + odometry.phh
    return total - total != 0.0


def bumper_hit(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger on a newly pressed bumper sector."""
    return state.bumped


def wheel_stuck(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger if a commanded wheel does not turn."""
    return state.stall.stuck


def operator_lost(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger without operator heartbeats in MANUAL, or with an active goal in GUIDED.

    Only while armed: a robot that is armed without its operator holds.
    """
    machine = state.machine
    if machine.operator or machine.vehicle != states.ACTIVE:
        return False
    return machine.mode == states.MANUAL or (
        machine.mode == states.GUIDED and modes.goal_is_active(machine)
    )


def fence_unchecked(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger with a fence while the place is unknown, which also forbids arming."""
    return state.machine.fence is not None and not state.machine.placed


def fence_breached(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger outside the fence or in an exclusion; this forbids arming until it is removed."""
    machine, pose = state.machine, state.odometry.pose
    fence = machine.fence
    if fence is None:
        return False
    return not fences.allows(fence, machine.exclusions, pose.x_m, pose.y_m)


def budget_violated(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger if the host reports a violated time budget."""
    return state.reported == reasons.BUDGET


def core_failed(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger if the host reports an exception of the core."""
    return state.reported == reasons.CORE_EXCEPTION


def name_taken(state: State, inputs: Inputs, params: Params) -> bool:
    """Trigger if another robot has the same name and would drive the same wheels."""
    return state.reported == reasons.NAME_TAKEN


def trip(machine: Machine, reason: int, now_ms: int) -> None:
    """Stop for this reason until armed again; an emergency stop has priority and stays."""
    modes.end_goal(machine, states.ABORTED, reason, now_ms)
    if machine.vehicle != states.EMERGENCY_STOP:
        machine.vehicle = states.FAILSAFE
        machine.vehicle_reason = reason


class Trigger(Protocol):
    """A condition of the failsafe table."""

    def __call__(self, state: State, inputs: Inputs, params: Params) -> bool:
        """Return whether the condition holds."""


class Action(Protocol):
    """An action of the failsafe table."""

    def __call__(self, machine: Machine, reason: int, now_ms: int) -> None:
        """Stop the robot for a reason."""


FailsafeRow = NamedTuple(
    "FailsafeRow", [("reason", int), ("trigger", "Trigger"), ("limit", str), ("action", "Action")]
)
"""A reason, its trigger, the limit or the parameters that set it, and the action."""

ROWS: Final = (
    FailsafeRow(reasons.CORE_EXCEPTION, core_failed, "reported by the host", trip),
    FailsafeRow(reasons.NAME_TAKEN, name_taken, "a second robot of this name: by the host", trip),
    FailsafeRow(
        reasons.BUDGET, budget_violated, "3 overruns in a row, a period late: by the host", trip
    ),
    FailsafeRow(reasons.TICKS_LOST, ticks_lost, "TICKS_LOST_MS, decided by the host", trip),
    FailsafeRow(reasons.SCAN_LOST, scan_lost, "SCAN_LOST_MS, decided by the host", trip),
    FailsafeRow(reasons.NOT_FINITE, not_finite, "pose, covariance, twist", trip),
    FailsafeRow(reasons.BUMPER, bumper_hit, "a sector newly pressed", trip),
    FailsafeRow(
        reasons.ENCODER_IMPOSSIBLE, encoder_impossible, "twice wheel_max_m_s + 20 mm", trip
    ),
    FailsafeRow(reasons.SONAR_IMPOSSIBLE, sonar_impossible, "0 or beyond 1.1 sonar_max_m", trip),
    FailsafeRow(reasons.SONAR_FROZEN, sonar_frozen, "freeze_m, freeze_rad, freeze_front_m", trip),
    FailsafeRow(
        reasons.WHEEL_STUCK, wheel_stuck, "wheel_min_m_s, wheel_time_ms, wheel_share", trip
    ),
    FailsafeRow(reasons.OPERATOR_LOST, operator_lost, "op_lost_ms in GUIDED or MANUAL", trip),
    FailsafeRow(reasons.FENCE_UNCHECKED, fence_unchecked, "a fence, and the place unknown", trip),
    FailsafeRow(
        reasons.FENCE_BREACHED, fence_breached, "the fence, for the middle of the robot", trip
    ),
)

TRIGGERS: Final = tuple([(row.trigger, row) for row in ROWS])


def check(state: State, inputs: Inputs, params: Params) -> None:
    """Find the first row that triggers: it forbids arming, and stops an armed robot."""
    machine = state.machine
    machine.cause = reasons.OK
    for trigger, row in TRIGGERS:
        if trigger(state, inputs, params):
            machine.cause = row.reason
            if machine.vehicle == states.ACTIVE:
                row.action(machine, row.reason, inputs.now_ms)
            break
    state.reported = reasons.OK
