"""Bug1 (Lumelsky and Stepanov 1987): circle the obstacle, return to its nearest point, leave.

From the nearest point of a boundary, a reachable goal is not behind the same obstacle. A robot that
meets the same obstacle again from there has proof that the goal is unreachable.
"""

from math import inf
from typing import Final

from robot.core import states
from robot.core.navigators import classical as boundaries
from robot.core.navigators.classical import Boundary
from robot.core.navigators.memory import lap as laps
from robot.core.parameters import Params
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Decision, Goal, Pose

GOING: Final = 0
CIRCLING: Final = 1
RETURNING: Final = 2

AT_M: Final = 0.12
NEARER_M: Final = 0.10
TRIES: Final = 2  # drift may cause one miss of the nearest point


class Memory:
    """`nearest` is the point of the boundary nearest to the goal, `nearest_m` its distance.

    `nearest_at_m` is its position along the lap. `left_m` is the distance from the goal at the last
    leave.
    """

    __slots__ = (
        "boundary",
        "left_m",
        "nearest",
        "nearest_at_m",
        "nearest_m",
        "phase",
        "return_m",
        "side",
        "tries",
    )

    def __init__(self) -> None:
        self.boundary = Boundary()
        self.side: int = states.LEFT
        self.phase: int = GOING
        self.nearest = Pose(0.0, 0.0, 0.0)
        self.nearest_m = self.left_m = inf
        self.nearest_at_m = self.return_m = 0.0
        self.tries = 0


def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Return where to drive: at the goal, around the obstacle, or back to its nearest point."""
    boundary = memory.boundary
    if boundaries.is_not_finite(pose, goal):
        return boundaries.halt(ring, goal)
    if boundaries.look(boundary, pose, ring, goal, params):
        memory.phase, memory.left_m, memory.tries = GOING, inf, 0
    if not boundary.following:
        memory.phase = GOING
    if memory.phase == GOING:
        if boundaries.meets(boundary, params) and not meet(memory, pose, params):
            return boundaries.give_up(boundary, ring, goal)
    elif boundaries.under_way(boundary) and boundaries.goal_at_hand(boundary, params):
        leave(memory)
    elif memory.phase == CIRCLING:
        circle(memory, pose)
    else:
        come_back(memory, pose)
    return boundaries.decision(boundary, pose, ring, goal, params)


def meet(memory: Memory, pose: Pose, params: Params) -> bool:
    """Start to circle the obstacle; return False if that was done without success before."""
    boundary = memory.boundary
    if boundary.distance_m < memory.left_m - NEARER_M:
        memory.tries = 0
    else:
        memory.tries += 1
        if memory.tries >= TRIES:
            return False
    boundaries.follow(boundary, pose, memory.side, params)
    memory.phase = CIRCLING
    memory.nearest, memory.nearest_m, memory.nearest_at_m = pose, boundary.distance_m, 0.0
    boundaries.circle(boundary, pose, True)
    return True


def circle(memory: Memory, pose: Pose) -> None:
    """Note the nearest point; after a full lap return to it by the shorter way."""
    boundary, lap = memory.boundary, memory.boundary.lap
    if boundary.distance_m < memory.nearest_m:
        memory.nearest, memory.nearest_m = pose, boundary.distance_m
        memory.nearest_at_m = lap.at_m
    marked, mark = lap.marked, lap.mark
    closed = laps.closed(lap, pose)
    if marked and lap.mark is not mark:
        memory.nearest, memory.nearest_m = pose, boundary.distance_m
        memory.nearest_at_m = lap.at_m
    if closed:
        round_m = lap.at_m - lap.mark_at_m
        on_m = (memory.nearest_at_m - lap.at_m) % max(round_m, 1e-3)
        back_m = round_m - on_m
        memory.phase = RETURNING
        memory.return_m = 1.5 * min(on_m, back_m) + 1.0
        if back_m < on_m:
            boundary.follower.side = -boundary.follower.side
        laps.begin(lap, pose)


def come_back(memory: Memory, pose: Pose) -> None:
    """Leave at the nearest point, or after the distance at which it should have been reached."""
    boundary, lap = memory.boundary, memory.boundary.lap
    laps.closed(lap, pose)
    here = laps.apart_m(pose, memory.nearest) <= AT_M
    if here or boundary.distance_m <= memory.nearest_m or lap.at_m > memory.return_m:
        leave(memory)


def leave(memory: Memory) -> None:
    """Leave the boundary and head for the goal."""
    memory.left_m = min(memory.left_m, memory.nearest_m)
    memory.phase = GOING
    boundaries.leave(memory.boundary)
