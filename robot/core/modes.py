"""Vehicle, mode and goal of the robot, and the operator's commands that change them.

Each command returns a reason, 0 if accepted.
"""

from math import pi
from typing import Final

from robot.core import reasons, states
from robot.core.motion import Trail
from robot.core.navigators.registry import NAVIGATORS
from robot.core.parameters import Params
from robot.core.safety import fence as fences
from robot.core.safety.fence import Fence
from robot.core.values import Goal, Pose


class Machine:
    """Vehicle, mode and goal with their reasons; `serial` counts goals.

    `cause` is the failsafe condition that holds now, armed or not. `senses` and `operator` are set
    if fresh sensor data and a fresh operator heartbeat were present in the last step.
    `replaced_serial` is the last goal ended by a newer one (ABORTED, REPLACED). `fence` is the area
    that the robot must not leave, or None, and `exclusions` are those within that it must not
    enter; `fence_unreadable` means that a saved fence is lost.
    `placed` means that the robot knows its place in the world (see `place`).
    `pursuits` counts fresh starts of driving: a new goal, or the same goal with another navigator.
    """

    __slots__ = (
        "cause",
        "exclusions",
        "fence",
        "fence_unreadable",
        "goal",
        "goal_ended_ms",
        "goal_max_m",
        "goal_reason",
        "goal_started_ms",
        "goal_state",
        "mode",
        "navigator",
        "operator",
        "placed",
        "pursuits",
        "replaced_serial",
        "resume_mode",
        "senses",
        "serial",
        "side",
        "vehicle",
        "vehicle_reason",
    )

    def __init__(self, params: Params) -> None:
        self.vehicle: int = states.BOOT
        self.vehicle_reason: int = reasons.OK
        self.mode: int = states.HOLD
        self.resume_mode: int = states.GUIDED
        self.goal: Goal | None = None
        self.goal_state: int = states.NONE
        self.goal_reason: int = reasons.OK
        self.goal_started_ms = 0
        self.goal_ended_ms = 0
        self.serial = self.pursuits = 0
        self.replaced_serial = 0
        self.navigator: int = params.navigator
        self.side: int = params.side
        self.goal_max_m: float = params.goal_max_m
        self.fence: Fence | None = None
        self.exclusions: "tuple[Fence, ...]" = ()
        self.fence_unreadable = False
        self.placed = True
        self.senses = False
        self.operator = False
        self.cause: int = reasons.OK


def goal_is_active(machine: Machine) -> bool:
    """Return whether there is a goal that has not ended."""
    return states.ACCEPTED <= machine.goal_state <= states.ALIGNING


def drives(machine: Machine) -> bool:
    """Return whether the robot is armed, in a driving mode, and has an active goal."""
    return (
        machine.vehicle == states.ACTIVE
        and machine.mode >= states.AUTO
        and states.ACCEPTED <= machine.goal_state <= states.ALIGNING
    )


def start_goal(machine: Machine, goal: Goal, mode: int, now_ms: int) -> None:
    """Set a new goal; an active one becomes ABORTED, REPLACED, shown by `replaced_serial`."""
    if goal_is_active(machine):
        machine.replaced_serial = machine.serial
    machine.serial += 1
    machine.pursuits += 1
    machine.goal = goal
    machine.goal_state = states.ACCEPTED
    machine.goal_reason = reasons.OK
    machine.goal_started_ms = now_ms
    machine.goal_ended_ms = 0
    machine.mode = mode


def end_goal(machine: Machine, goal_state: int, reason: int, now_ms: int) -> None:
    """End an active goal with an outcome; a goal that has ended keeps its outcome."""
    if goal_is_active(machine):
        machine.goal_state = goal_state
        machine.goal_reason = reason
        machine.goal_ended_ms = now_ms


MIN_POSITION_TOLERANCE_M: Final = 0.005
MAX_POSITION_TOLERANCE_M: Final = 1.0
MIN_HEADING_TOLERANCE_RAD: Final = 0.2 * pi / 180.0
MAX_HEADING_TOLERANCE_RAD: Final = pi
EPSILON: Final = 1e-6  # the wire rounds a tolerance to whole units


def arm(machine: Machine) -> int:
    """Let the wheels turn.

    This requires fresh sensor data, no failsafe condition, and a fence that is readable if there is
    one. MANUAL without an operator becomes HOLD, because it would fail at once.
    """
    if machine.vehicle == states.EMERGENCY_STOP:
        return reasons.EMERGENCY_STOPPED
    if machine.vehicle == states.BOOT or not machine.senses:
        return reasons.NO_SENSES
    if machine.vehicle == states.ACTIVE:
        return reasons.OK
    if machine.fence_unreadable:
        return reasons.FENCE_UNREADABLE
    if machine.cause != reasons.OK:
        return machine.cause
    if machine.mode == states.MANUAL and not machine.operator:
        hold(machine)
    machine.vehicle = states.ACTIVE
    machine.vehicle_reason = reasons.OK
    return reasons.OK


def disarm(machine: Machine, now_ms: int) -> int:
    """Stop the wheels and end the goal; an emergency stop stays latched."""
    end_goal(machine, states.ABORTED, reasons.DISARMED, now_ms)
    if machine.vehicle in (states.ACTIVE, states.FAILSAFE):
        enter_standby(machine)
    return reasons.OK


def estop(machine: Machine, now_ms: int) -> int:
    """Latch the emergency stop: end the goal and stop until it is cleared."""
    end_goal(machine, states.ABORTED, reasons.BY_EMERGENCY_STOP, now_ms)
    machine.vehicle = states.EMERGENCY_STOP
    machine.vehicle_reason = reasons.BY_OPERATOR
    return reasons.OK


def clear_estop(machine: Machine) -> int:
    """Release a latched emergency stop; the vehicle is then disarmed in STANDBY."""
    if machine.vehicle == states.EMERGENCY_STOP:
        enter_standby(machine)
    return reasons.OK


def enter_standby(machine: Machine) -> None:
    """Enter STANDBY; show FENCE_UNREADABLE as the reason if the fence is lost."""
    machine.vehicle = states.STANDBY
    unreadable = machine.fence_unreadable
    machine.vehicle_reason = reasons.FENCE_UNREADABLE if unreadable else reasons.OK


def hold(machine: Machine) -> int:
    """Stop and keep the goal."""
    if machine.mode != states.HOLD:
        machine.resume_mode = machine.mode
        machine.mode = states.HOLD
    return reasons.OK


def resume(machine: Machine) -> int:
    """Continue to the goal that `hold` kept, in its mode."""
    if not goal_is_active(machine):
        return reasons.NO_GOAL
    if machine.mode != states.HOLD:
        return reasons.OK
    refusal = may_drive(machine, machine.resume_mode)
    if refusal == reasons.OK:
        machine.mode = machine.resume_mode
    return refusal


def abort(machine: Machine, now_ms: int) -> int:
    """Drop the goal and stop, armed."""
    if not goal_is_active(machine):
        return reasons.NOTHING_TO_ABORT
    end_goal(machine, states.ABORTED, reasons.BY_OPERATOR, now_ms)
    return reasons.OK


def goto(machine: Machine, goal: Goal, mode: int, now_ms: int, from_robot: bool = False) -> int:
    """Drive to a pose in AUTO or GUIDED and replace an active goal; a refusal changes neither.

    Only before the first goal does a refusal set the state of the goal. Later, the state of the
    last goal remains, because an operator may continue to it. `from_robot`: the goal was given
    relative to the robot, so its place may be unknown.
    """
    refusal = refusal_of(machine, goal, mode)
    if not (machine.placed or from_robot):
        refusal = reasons.PLACE_UNKNOWN
    if refusal == reasons.OK:
        start_goal(machine, goal, mode, now_ms)
    elif machine.goal is None:
        machine.goal_state = states.REFUSED
        machine.goal_reason = refusal
    return refusal


def rtl(machine: Machine, trail: Trail, now_ms: int) -> int:
    """Drive back to the start along the recorded trail."""
    if not machine.placed:
        return reasons.PLACE_UNKNOWN
    refusal = may_drive(machine, states.SMART_RTL)
    if refusal != reasons.OK:
        return refusal
    if not trail.count:
        return reasons.NO_TRAIL
    if machine.fence is not None:
        for i in range(trail.count):
            if not is_permitted(machine, trail.xs_m[i], trail.ys_m[i]):
                return reasons.OUTSIDE_FENCE
    start = Goal(trail.xs_m[0], trail.ys_m[0], None, 0.05, pi)
    start_goal(machine, start, states.SMART_RTL, now_ms)
    return reasons.OK


def set_mode(machine: Machine, trail: Trail, mode: int, now_ms: int) -> int:
    """Change the mode: an active goal continues in AUTO and GUIDED and ends in MANUAL."""
    if mode == states.HOLD:
        return hold(machine)
    if mode == states.SMART_RTL:
        return rtl(machine, trail, now_ms)
    if mode not in (states.MANUAL, states.AUTO, states.GUIDED):
        return reasons.UNKNOWN_MODE
    if mode != states.AUTO and not machine.operator:
        return reasons.NO_OPERATOR
    if mode == states.MANUAL or machine.mode == states.SMART_RTL:
        reason = reasons.BY_HAND if mode == states.MANUAL else reasons.BY_OPERATOR
        end_goal(machine, states.ABORTED, reason, now_ms)
    machine.mode = mode
    return reasons.OK


def is_permitted(machine: Machine, x_m: float, y_m: float) -> bool:
    """Return whether the fence, if there is one, allows a point."""
    fence = machine.fence
    return fence is None or fences.allows(fence, machine.exclusions, x_m, y_m)


def set_fence(
    machine: Machine, fence: "Fence | None", pose: Pose, exclusions: "tuple[Fence, ...]" = ()
) -> int:
    """Set a fence with its exclusions, or with None remove it, and return a reason, 0 if done."""
    refusal = fence_problem(machine, fence, pose, exclusions)
    if refusal != reasons.OK:
        return refusal
    machine.fence = fence
    machine.exclusions = exclusions
    machine.fence_unreadable = False
    if machine.vehicle_reason == reasons.FENCE_UNREADABLE:
        machine.vehicle_reason = reasons.OK
    return reasons.OK


def fence_problem(
    machine: Machine, fence: "Fence | None", pose: Pose, exclusions: "tuple[Fence, ...]"
) -> int:
    """Return why a fence is refused, or 0; it must allow the robot and an active goal.

    Before the first sensor data the fence may exclude the robot: arming is refused then. After them
    the robot must know its place.
    """
    if fence is None:
        return reasons.OK
    shapes = [fence]
    shapes.extend(exclusions)
    for one in shapes:
        refusal = fences.refusal_of(one)
        if refusal != reasons.OK:
            return refusal
    if machine.vehicle != states.BOOT:
        if not machine.placed:
            return reasons.PLACE_UNKNOWN
        if not fences.allows(fence, exclusions, pose.x_m, pose.y_m):
            return reasons.FENCE_LEAVES_ROBOT_OUT
    goal = machine.goal
    if goal is None or fences.allows(fence, exclusions, goal.x_m, goal.y_m):
        return reasons.OK
    return reasons.OUTSIDE_FENCE if goal_is_active(machine) else reasons.OK


def lose_fence(machine: Machine) -> None:
    """Forbid arming until a fence is set or removed, because the saved one is unreadable."""
    machine.fence_unreadable = True
    machine.vehicle_reason = reasons.FENCE_UNREADABLE


def set_navigator(machine: Machine, navigator: int, side: int) -> int:
    """Choose the navigator and the side on which it passes obstacles.

    An active goal continues from here with an empty memory.
    """
    if navigator not in NAVIGATORS:
        return reasons.UNKNOWN_NAVIGATOR
    if side not in (states.LEFT, states.RIGHT):
        return reasons.PARAMETER_OUT_OF_RANGE
    if navigator != machine.navigator or side != machine.side:
        machine.navigator = navigator
        machine.side = side
        machine.pursuits += 1
    return reasons.OK


def may_drive(machine: Machine, mode: int) -> int:
    """Return why driving in this mode is refused now, or 0."""
    if machine.vehicle == states.EMERGENCY_STOP:
        return reasons.EMERGENCY_STOPPED
    if machine.vehicle != states.ACTIVE:
        return reasons.NOT_ARMED
    if not machine.senses:
        return reasons.NO_SENSES
    if mode == states.GUIDED and not machine.operator:
        return reasons.NO_OPERATOR
    return reasons.OK


def refusal_of(machine: Machine, goal: Goal, mode: int) -> int:
    """Return why this goal is refused in this mode, or 0."""
    if mode not in (states.AUTO, states.GUIDED):
        return reasons.UNKNOWN_MODE
    refusal = may_drive(machine, mode)
    return goal_problem(machine, goal) if refusal == reasons.OK else refusal


def goal_problem(machine: Machine, goal: Goal) -> int:
    """Return why this goal is invalid for the robot's settings, or 0.

    NaN fails every comparison.
    """
    far_m = machine.goal_max_m
    if not (-far_m <= goal.x_m <= far_m and -far_m <= goal.y_m <= far_m):
        return reasons.GOAL_OUT_OF_RANGE
    if goal.heading_rad is not None and not -1e3 <= goal.heading_rad <= 1e3:
        return reasons.GOAL_OUT_OF_RANGE
    position_m, heading_rad = goal.position_tolerance_m, goal.heading_tolerance_rad
    if not MIN_POSITION_TOLERANCE_M <= position_m <= MAX_POSITION_TOLERANCE_M:
        return reasons.TOLERANCE_OUT_OF_RANGE
    low_rad, high_rad = MIN_HEADING_TOLERANCE_RAD - EPSILON, MAX_HEADING_TOLERANCE_RAD + EPSILON
    if not low_rad <= heading_rad <= high_rad:
        return reasons.TOLERANCE_OUT_OF_RANGE
    return reasons.OK if is_permitted(machine, goal.x_m, goal.y_m) else reasons.OUTSIDE_FENCE
