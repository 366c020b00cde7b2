"""Bug1 (Lumelsky and Stepanov 1987): circle the obstacle, return to its nearest point, leave.

From the nearest point of a boundary, a reachable goal is not behind the same obstacle. A robot that
meets the same obstacle again from there has proof that the goal is unreachable.

Bug2 (Lumelsky and Stepanov 1987): follow the boundary to the line from start to goal.

The robot leaves the boundary on that line only if it is nearer to the goal than where it met the
obstacle. So each obstacle is met nearer than the one before. If the robot comes back to the meeting
point without leaving, the goal is unreachable.

DistBug (Kamon and Rivlin 1997): follow the boundary until a free way leads nearer than ever.

The free distance is what the sonars measure towards the goal, minus the distance to stop and turn.
"""

from math import inf, sqrt
from typing import Final

from robot.core import states
from robot.core.navigators import classical as boundaries
from robot.core.navigators import classical as laps
from robot.core.navigators.classical import Boundary
from robot.core.parameters import Params
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Decision, Goal, Pose

GOING: Final = 0
CIRCLING: Final = 1
RETURNING: Final = 2

AT_M: Final = 0.12
NEARER_M: Final = 0.10
TRIES: Final = 2  # drift may cause one miss of the nearest point


class Bug1Memory:
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


def step_bug1(memory: Bug1Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
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


def meet(memory: Bug1Memory, pose: Pose, params: Params) -> bool:
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


def circle(memory: Bug1Memory, pose: Pose) -> None:
    """Note the nearest point; after a full lap return to it by the shorter way."""
    boundary, lap = memory.boundary, memory.boundary.lap
    if boundary.distance_m < memory.nearest_m:
        memory.nearest, memory.nearest_m = pose, boundary.distance_m
        memory.nearest_at_m = lap.at_m
    marked, mark = lap.marked, lap.mark
    closed = laps.closes_lap(lap, pose)
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


def come_back(memory: Bug1Memory, pose: Pose) -> None:
    """Leave at the nearest point, or after the distance at which it should have been reached."""
    boundary, lap = memory.boundary, memory.boundary.lap
    laps.closes_lap(lap, pose)
    here = laps.apart_m(pose, memory.nearest) <= AT_M
    if here or boundary.distance_m <= memory.nearest_m or lap.at_m > memory.return_m:
        leave(memory)


def leave(memory: Bug1Memory) -> None:
    """Leave the boundary and head for the goal."""
    memory.left_m = min(memory.left_m, memory.nearest_m)
    memory.phase = GOING
    boundaries.leave(memory.boundary)


ON_LINE_M: Final = 0.03


class Bug2Memory:
    """The line starts at `start_x_m`, `start_y_m`; `aside_m` is the robot's offset to its left."""

    __slots__ = ("aside_m", "boundary", "side", "start_x_m", "start_y_m")

    def __init__(self) -> None:
        self.boundary = Boundary()
        self.side: int = states.LEFT
        self.start_x_m = self.start_y_m = self.aside_m = 0.0


def step_bug2(memory: Bug2Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Return where to drive: at the goal, or along the boundary."""
    boundary = memory.boundary
    if boundaries.is_not_finite(pose, goal):
        return boundaries.halt(ring, goal)
    if boundaries.look(boundary, pose, ring, goal, params):
        memory.start_x_m, memory.start_y_m = pose.x_m, pose.y_m
    crossed = crosses(memory, pose, goal)
    if boundaries.under_way(boundary) and leaves_bug2(boundary, crossed, params):
        boundaries.leave(boundary)
    elif not boundaries.advance(boundary, pose, memory.side, boundary.distance_m, NEARER_M, params):
        return boundaries.give_up(boundary, ring, goal)
    return boundaries.decision(boundary, pose, ring, goal, params)


def crosses(memory: Bug2Memory, pose: Pose, goal: Goal) -> bool:
    """Return whether the robot is on the line, or has crossed it since the last tick."""
    along_x_m, along_y_m = goal.x_m - memory.start_x_m, goal.y_m - memory.start_y_m
    length_m = sqrt(along_x_m * along_x_m + along_y_m * along_y_m)
    dx_m, dy_m = pose.x_m - memory.start_x_m, pose.y_m - memory.start_y_m
    aside_m = (along_x_m * dy_m - along_y_m * dx_m) / max(length_m, 1e-6)
    before_m = memory.aside_m
    memory.aside_m = aside_m
    return abs(aside_m) < ON_LINE_M or aside_m * before_m < 0.0


def leaves_bug2(boundary: Boundary, crossed: bool, params: Params) -> bool:
    """Return whether to leave: on the line, and nearer than where the obstacle was met."""
    if boundaries.goal_at_hand(boundary, params) or boundaries.leave_at_nearest(boundary):
        return True
    return crossed and boundary.distance_m <= boundary.begun_m - NEARER_M


STEP_M: Final = 0.05
SURE_TICKS: Final = 3  # during a quick turn a range is of an earlier bearing
STRIP_M: Final = 0.04
SHORT_M: Final = 0.25  # the obstacle may begin this much before its echo


class DistBugMemory:
    """`open_ticks` counts the ticks for which the way to the goal has been good enough to leave."""

    __slots__ = ("boundary", "open_ticks", "side")

    def __init__(self) -> None:
        self.boundary = Boundary()
        self.side: int = states.LEFT
        self.open_ticks = 0


def step_distbug(
    memory: DistBugMemory, pose: Pose, ring: Ring, goal: Goal, params: Params
) -> Decision:
    """Return where to drive: at the goal, or along the boundary."""
    boundary = memory.boundary
    if boundaries.is_not_finite(pose, goal):
        return boundaries.halt(ring, goal)
    boundaries.look(boundary, pose, ring, goal, params)
    if not boundary.following:
        memory.open_ticks = 0
    if boundaries.under_way(boundary) and leaves_distbug(memory, params):
        boundaries.leave(boundary)
    elif not boundaries.advance(boundary, pose, memory.side, boundary.best_m, STEP_M, params):
        return boundaries.give_up(boundary, ring, goal)
    return boundaries.decision(boundary, pose, ring, goal, params)


def leaves_distbug(memory: DistBugMemory, params: Params) -> bool:
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
