"""Convert a mission item to a goal pose and a waiting time, and check it."""

from math import isnan, radians
from typing import Final, NamedTuple

from protocol.wire.enums import FRAME_LOCAL_FLU, Command
from protocol.wire.messages import MissionItemInt
from robot.core import modes, reasons
from robot.core.modes import Machine
from robot.core.values import Goal

PER_M: Final = 10_000.0
"""Items hold local positions in metres times this factor."""
MAX_HOLD_S: Final = 3600.0


class MissionStop(NamedTuple):
    """A goal, and the time to wait there."""

    goal: Goal
    hold_ms: int


def stop_of(item: MissionItemInt) -> MissionStop:
    """Return the stop that an item describes; the item need not be valid."""
    heading_rad = None if isnan(item.param4) else radians(item.param4)
    place_m = item.x / PER_M, item.y / PER_M
    goal = Goal(*place_m, heading_rad, tidy(item.param2), radians(item.param3))
    return MissionStop(goal, round(1000.0 * item.param1))


def problem_of(item: MissionItemInt, machine: Machine) -> int:
    """Return why the robot cannot drive to this item, or 0; NaN fails every comparison."""
    if item.command != Command.SIDESTEP_NAV_POSE:
        return reasons.UNKNOWN_COMMAND
    if item.frame != FRAME_LOCAL_FLU:
        return reasons.UNKNOWN_FRAME
    if not 0.0 <= item.param1 <= MAX_HOLD_S:
        return reasons.HOLD_OUT_OF_RANGE
    return modes.goal_problem(machine, stop_of(item).goal)


def tidy(value: float) -> float:
    """Undo the rounding of a decimal number to float32, such as 0.005."""
    return float(f"{value:.7g}")
