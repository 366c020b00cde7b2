"""The state of vehicle, mode and goal, and its few transitions."""

from robot.core import reasons, states
from robot.core.parameters import Params
from robot.core.safety.fence import Fence
from robot.core.values import Goal


class Machine:
    """Vehicle, mode and goal with their reasons; `serial` counts goals.

    `cause` is the failsafe condition that holds now, armed or not. `senses` and `operator` are set
    if fresh sensor data and a fresh operator heartbeat were present in the last step.
    `replaced_serial` is the last goal ended by a newer one (ABORTED, REPLACED). `fence` is the area
    that the robot must not leave, or None; `fence_unreadable` means that a saved fence is lost.
    `placed` means that the robot knows its place in the world (see `place`).
    `pursuits` counts fresh starts of driving: a new goal, or the same goal with another navigator.
    """

    __slots__ = (
        "cause",
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
