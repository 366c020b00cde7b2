"""Bug2 (Lumelsky and Stepanov 1987): follow the boundary to the line from start to goal.

The robot leaves the boundary on that line only if it is nearer to the goal than where it met the
obstacle. So each obstacle is met nearer than the one before. If the robot comes back to the meeting
point without leaving, the goal is unreachable.
"""

from math import sqrt
from typing import Final

from robot.core import states
from robot.core.navigators import classical as boundaries
from robot.core.navigators.classical import Boundary
from robot.core.parameters import Params
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Decision, Goal, Pose

ON_LINE_M: Final = 0.03
NEARER_M: Final = 0.10


class Memory:
    """The line starts at `start_x_m`, `start_y_m`; `aside_m` is the robot's offset to its left."""

    __slots__ = ("aside_m", "boundary", "side", "start_x_m", "start_y_m")

    def __init__(self) -> None:
        self.boundary = Boundary()
        self.side: int = states.LEFT
        self.start_x_m = self.start_y_m = self.aside_m = 0.0


def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Return where to drive: at the goal, or along the boundary."""
    boundary = memory.boundary
    if boundaries.is_not_finite(pose, goal):
        return boundaries.halt(ring, goal)
    if boundaries.look(boundary, pose, ring, goal, params):
        memory.start_x_m, memory.start_y_m = pose.x_m, pose.y_m
    crossed = crosses(memory, pose, goal)
    if boundaries.under_way(boundary) and leaves(boundary, crossed, params):
        boundaries.leave(boundary)
    elif not boundaries.advance(boundary, pose, memory.side, boundary.distance_m, NEARER_M, params):
        return boundaries.give_up(boundary, ring, goal)
    return boundaries.decision(boundary, pose, ring, goal, params)


def crosses(memory: Memory, pose: Pose, goal: Goal) -> bool:
    """Return whether the robot is on the line, or has crossed it since the last tick."""
    along_x_m, along_y_m = goal.x_m - memory.start_x_m, goal.y_m - memory.start_y_m
    length_m = sqrt(along_x_m * along_x_m + along_y_m * along_y_m)
    dx_m, dy_m = pose.x_m - memory.start_x_m, pose.y_m - memory.start_y_m
    aside_m = (along_x_m * dy_m - along_y_m * dx_m) / max(length_m, 1e-6)
    before_m = memory.aside_m
    memory.aside_m = aside_m
    return abs(aside_m) < ON_LINE_M or aside_m * before_m < 0.0


def leaves(boundary: Boundary, crossed: bool, params: Params) -> bool:
    """Return whether to leave: on the line, and nearer than where the obstacle was met."""
    if boundaries.goal_at_hand(boundary, params) or boundaries.leave_at_nearest(boundary):
        return True
    return crossed and boundary.distance_m <= boundary.begun_m - NEARER_M
