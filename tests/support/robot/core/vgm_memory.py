"""Ticks of vgm_memory in front of given echoes."""

import pytest

from robot.core import states
from robot.core.navigators import vgm_memory
from robot.core.navigators.vgm_following import Memory
from robot.core.parameters import DEFAULTS
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Decision, Goal, Pose
from tests.support.robot.core.rings import HERE

GOAL = Goal(3.0, 0.0, None, 0.05, 0.05)
SIDES = pytest.mark.parametrize("side", [states.LEFT, states.RIGHT])


def step(memory: Memory, pose: Pose, seen: Ring, goal: Goal = GOAL) -> Decision:
    return vgm_memory.step(memory, pose, seen, goal, DEFAULTS)


def stand(memory: Memory, seen: Ring, ticks: int, goal: Goal = GOAL) -> Decision:
    for _ in range(ticks):
        decision = step(memory, HERE, seen, goal)
    return decision
