"""distbug: registered under its number; until its own step is here it drives like vgm."""

from robot.core import vgm
from robot.core.memory import Memory
from robot.core.parameters import Params
from robot.core.ring import Ring
from robot.core.values import Decision, Goal, Pose

__all__ = ["Memory", "step"]


def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    return vgm.step(memory, pose, ring, goal, params)
