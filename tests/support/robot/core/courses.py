"""Obstacles and goals that the bug navigators are tested with."""

from robot.core.values import Goal
from tests.support.robot.core.rings import Disc, Wall

GOAL = Goal(2.4, 0.0, None, 0.05, 0.05)
FAR = Goal(3.4, 0.0, None, 0.05, 0.05)
DISC: list[Disc] = [(1.2, 0.1, 0.4)]
BOX_AROUND_THE_GOAL: list[Wall] = [
    (1.6, -0.6, 3.0, -0.6),
    (3.0, -0.6, 3.0, 0.6),
    (3.0, 0.6, 1.6, 0.6),
    (1.6, 0.6, 1.6, -0.6),
]

U_TRAP: list[Wall] = [(0.8, 0.5, 2.0, 0.5), (2.0, 0.5, 2.0, -0.5), (2.0, -0.5, 0.8, -0.5)]
BEHIND_THE_TRAP = Goal(3.2, 0.0, None, 0.05, 0.05)
