"""A mission item as the robot understands it: a pose to drive to, and how long to wait there."""

from math import isnan, radians
from typing import Final, NamedTuple

from protocol.wire.enums import FRAME_LOCAL_FLU, Command
from protocol.wire.messages import MissionItemInt
from robot.core import modes, reasons
from robot.core.machine import Machine
from robot.core.values import Goal

PER_M: Final = 10_000.0
"""Local positions of MAVLink's integer items are metres times this."""
MAX_HOLD_S: Final = 3600.0


class MissionStop(NamedTuple):
    """Where to, and for how long."""

    goal: Goal
    hold_ms: int


def stop_of(item: MissionItemInt) -> MissionStop:
    """What a good item says; of a bad one, what its numbers come to."""
    heading_rad = None if isnan(item.param4) else radians(item.param4)
    place_m = item.x / PER_M, item.y / PER_M
    goal = Goal(*place_m, heading_rad, tidy(item.param2), radians(item.param3))
    return MissionStop(goal, round(1000.0 * item.param1))


def problem_of(item: MissionItemInt, machine: Machine) -> int:
    """Why the robot cannot do this item, or 0. NaN fails every comparison."""
    if item.command != Command.SIDESTEP_NAV_POSE:
        return reasons.UNKNOWN_COMMAND
    if item.frame != FRAME_LOCAL_FLU:
        return reasons.UNKNOWN_FRAME
    if not 0.0 <= item.param1 <= MAX_HOLD_S:
        return reasons.HOLD_OUT_OF_RANGE
    return modes.goal_problem(machine, stop_of(item).goal)


def tidy(value: float) -> float:
    """What float32 has made of a number with a few digits: 0.005 is 0.005 again."""
    return float(f"{value:.7g}")
