"""DistBug (Kamon and Rivlin 1997): follow the boundary until a free way leads nearer than ever.

The free distance is what the sonars measure towards the goal, minus the distance to stop and turn.
"""

from typing import Final

from robot.core import states
from robot.core.navigators import classical as boundaries
from robot.core.navigators.classical import Boundary
from robot.core.parameters import Params
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Decision, Goal, Pose

STEP_M: Final = 0.05
SURE_TICKS: Final = 3  # during a quick turn a range is of an earlier bearing
STRIP_M: Final = 0.04
SHORT_M: Final = 0.25  # the obstacle may begin this much before its echo


class Memory:
    """`open_ticks` counts the ticks for which the way to the goal has been good enough to leave."""

    __slots__ = ("boundary", "open_ticks", "side")

    def __init__(self) -> None:
        self.boundary = Boundary()
        self.side: int = states.LEFT
        self.open_ticks = 0


def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Return where to drive: at the goal, or along the boundary."""
    boundary = memory.boundary
    if boundaries.is_not_finite(pose, goal):
        return boundaries.halt(ring, goal)
    boundaries.look(boundary, pose, ring, goal, params)
    if not boundary.following:
        memory.open_ticks = 0
    if boundaries.under_way(boundary) and leaves(memory, params):
        boundaries.leave(boundary)
    elif not boundaries.advance(boundary, pose, memory.side, boundary.best_m, STEP_M, params):
        return boundaries.give_up(boundary, ring, goal)
    return boundaries.decision(boundary, pose, ring, goal, params)


def leaves(memory: Memory, params: Params) -> bool:
    """Return whether leaving leads nearer to the goal than the robot has ever been."""
    boundary = memory.boundary
    memory.open_ticks = memory.open_ticks + 1 if leads_nearer(boundary, params) else 0
    if memory.open_ticks >= SURE_TICKS:
        return True
    return boundaries.goal_at_hand(boundary, params) or boundaries.leave_at_nearest(boundary)


def leads_nearer(boundary: Boundary, params: Params) -> bool:
    """Return whether the free distance, less that to stop and turn, leads nearer than ever."""
    if abs(boundary.bearing_rad) > boundaries.IN_VIEW_RAD:
        return False
    room_m = params.radius_m + STRIP_M
    far_m = boundaries.free_m(boundary.follower, boundary.bearing_rad, room_m, params)
    free_m = min(far_m, params.sonar_max_m) - SHORT_M - params.radius_m
    return boundary.distance_m - max(free_m, 0.0) <= boundary.best_m - STEP_M
