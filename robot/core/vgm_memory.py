"""vgm_memory: registered under its number; until its own step is here it drives like vgm."""

from robot.core import states, vgm
from robot.core.memory import Memory as Paper
from robot.core.parameters import Params
from robot.core.ring import Ring
from robot.core.values import Decision, Goal, Pose


class Memory:
    """`side` is where obstacles are passed first."""

    __slots__ = ("paper", "side")

    def __init__(self) -> None:
        self.paper = Paper()
        self.side: int = states.LEFT


def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    return vgm.step(memory.paper, pose, ring, goal, params)
