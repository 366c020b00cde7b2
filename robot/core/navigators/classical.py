"""The classical bugs: Bug1, Bug2 and DistBug, with the detection of a full lap that they share.

They differ in when to leave the boundary, and in what a closed lap means. A lap is the same place
in the same direction; the place alone proves nothing, as the robot passes a corridor in both
directions.

- Bug1 (Lumelsky and Stepanov 1987) circles the obstacle, returns to its nearest point and leaves.
  From the nearest point of a boundary, a reachable goal is not behind the same obstacle, so a robot
  that meets the same obstacle again from there has proof that the goal is unreachable.
- Bug2 (Lumelsky and Stepanov 1987) follows the boundary to the line from start to goal. It leaves
  there only if it is nearer to the goal than where it met the obstacle, so each obstacle is met
  nearer than the one before. If the robot comes back to the meeting point without leaving, the goal
  is unreachable.
- DistBug (Kamon and Rivlin 1997) follows the boundary until a free way leads nearer than ever. The
  free distance is what the sonars measure towards the goal, minus the distance to stop and turn.
"""

from math import inf, pi, sqrt
from typing import Final

from robot.core import states
from robot.core.navigators import boundary_follower
from robot.core.navigators.boundary_follower import Follower
from robot.core.parameters import Params
from robot.core.perception import sonar_ring
from robot.core.perception.sonar_ring import AHEAD, Ring
from robot.core.ring import BEARINGS, HALF_CONE, SONARS
from robot.core.values import EVERY, Decision, Goal, Pose, wrap
from runtime.elementary import atan2, cos, cos_sin, sin

MARK_AFTER_M: Final = 0.35  # at the hit itself the robot is still turning
CLOSE_M: Final = 0.25
SAME_WAY_RAD: Final = pi / 3.0
ROUND_RAD: Final = 300.0 * pi / 180.0
MIN_LAP_M: Final = 0.5
WOUND_RAD: Final = 4.0 * pi  # without passing the mark: it is on another boundary
SPUN_RAD: Final = 6.0 * pi  # boxed in


class Lap:
    """The mark, and distance and turn since then; `at_m` is the distance along the boundary."""

    __slots__ = ("at_m", "last", "mark", "mark_at_m", "marked", "turned_rad")

    def __init__(self) -> None:
        self.mark = self.last = Pose(0.0, 0.0, 0.0)
        self.marked = False
        self.at_m = self.mark_at_m = self.turned_rad = 0.0


def begin(lap: Lap, pose: Pose) -> None:
    """Count from here."""
    lap.last = pose
    lap.marked = False
    lap.at_m = lap.turned_rad = 0.0


def resume(lap: Lap, pose: Pose) -> None:
    """Continue after leaving the boundary; the distance in between does not count."""
    lap.turned_rad += wrap(pose.heading_rad - lap.last.heading_rad)
    lap.last = pose


def closes_lap(lap: Lap, pose: Pose) -> bool:
    """Add one tick along the boundary; return True each time the mark is passed again."""
    lap.at_m += apart_m(lap.last, pose)
    lap.turned_rad += wrap(pose.heading_rad - lap.last.heading_rad)
    lap.last = pose
    spun = abs(lap.turned_rad) >= SPUN_RAD
    if not lap.marked:
        if lap.at_m >= MARK_AFTER_M or spun:
            mark(lap, pose)
            return spun
        return False
    if abs(lap.turned_rad) < ROUND_RAD:
        return False
    if not spun and lap.at_m - lap.mark_at_m < MIN_LAP_M:
        return False
    same_way = abs(wrap(pose.heading_rad - lap.mark.heading_rad)) <= SAME_WAY_RAD
    if not same_way or apart_m(lap.mark, pose) > CLOSE_M:
        if abs(lap.turned_rad) > WOUND_RAD:
            mark(lap, pose)
        return False
    lap.turned_rad = 0.0
    return True


def mark(lap: Lap, pose: Pose) -> None:
    """Set the mark: passing it again in the same direction completes a lap."""
    lap.mark = pose
    lap.mark_at_m = lap.at_m
    lap.marked = True
    lap.turned_rad = 0.0


def apart_m(one: Pose, other: Pose) -> float:
    """Return the distance between two poses."""
    dx_m, dy_m = one.x_m - other.x_m, one.y_m - other.y_m
    return sqrt(dx_m * dx_m + dy_m * dy_m)


HIT_M: Final = 0.03  # an obstacle with less clearance is in the way
HIT_LOOK_M: Final = 0.22
HIT_TICKS: Final = 2
NEAR_GOAL_M: Final = 0.60  # nearer, a free way in view is taken
LAPS: Final = 2
SETTLE_M: Final = 0.10
NEARER_M: Final = 0.10
AT_M: Final = 0.03
STOP_M: Final = 0.035
TIME_S: Final = 0.5
CREEP_M_S: Final = 0.03
AFAR_M: Final = 0.60  # nearer, a wall beside the way would seem to obstruct it
IN_VIEW_RAD: Final = 78.0 * pi / 180.0
CLOSING: Final = tuple([cos(max(abs(b) - HALF_CONE, 0.0)) for b in BEARINGS])
"""Share of the speed at which an echo may approach, as at the inner edge of its cone."""


class Boundary:
    """State of boundary following that the classical bug navigators share.

    `distance_m` and `bearing_rad` are those of the goal, `best_m` is the shortest distance to it so
    far. `lap` is the lap around the obstacle since it was met, and `laps` counts the laps
    completed. `begun_m` is the distance to the goal when the obstacle was met, `near_m` the
    shortest one during the lap. `left_at_nearest` is set once the robot has left the boundary at
    its nearest point without another reason (see `leave_at_nearest`).
    """

    __slots__ = (
        "bearing_rad",
        "begun_m",
        "best_m",
        "distance_m",
        "follower",
        "following",
        "goal_x_m",
        "goal_y_m",
        "hit_at_m",
        "lap",
        "laps",
        "left_at_nearest",
        "met_ticks",
        "near_m",
    )

    def __init__(self) -> None:
        self.follower = Follower()
        self.lap = Lap()
        self.following = False
        self.goal_x_m = self.goal_y_m = inf
        self.distance_m = self.best_m = self.begun_m = self.near_m = inf
        self.hit_at_m = 0.0
        self.laps = 0
        self.left_at_nearest = False
        self.bearing_rad = 0.0
        self.met_ticks = 0


def look(boundary: Boundary, pose: Pose, ring: Ring, goal: Goal, params: Params) -> bool:
    """Update from pose, ring and goal; return True if the goal is a new one."""
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    boundary.distance_m = sqrt(dx_m * dx_m + dy_m * dy_m)
    boundary.bearing_rad = wrap(atan2(dy_m, dx_m) - pose.heading_rad)
    boundary_follower.sense(boundary.follower, pose, ring, params)
    new = goal.x_m != boundary.goal_x_m or goal.y_m != boundary.goal_y_m
    if new:
        boundary.goal_x_m, boundary.goal_y_m = goal.x_m, goal.y_m
        boundary.following = False
        boundary.best_m = boundary.begun_m = inf
    boundary.best_m = min(boundary.best_m, boundary.distance_m)
    return new


def meets(boundary: Boundary, params: Params) -> bool:
    """Return whether an obstacle has been in the way to the goal for more than one scan."""
    clearance_m = 0.0 if boundary.distance_m < NEAR_GOAL_M else HIT_M
    room_m = params.radius_m + clearance_m
    look_m = min(HIT_LOOK_M, boundary.distance_m) + room_m
    met = free_way_m(boundary.follower, boundary.bearing_rad, room_m, params, True) < look_m
    boundary.met_ticks = boundary.met_ticks + 1 if met else 0
    return boundary.met_ticks >= HIT_TICKS


def free_way_m(
    follower: Follower, bearing_rad: float, room_m: float, params: Params, kind: bool = False
) -> float:
    """Return the distance from the robot's centre to the nearest echo in a strip.

    The strip has the half-width `room_m`. With `kind`, an ambiguous echo is placed where it leaves
    room within its cone, else where it leaves none. A missing measurement in the strip returns 0.
    """
    free_m = inf
    for i in EVERY:
        range_m = follower.seen_m[i]
        aside_rad = abs(wrap(BEARINGS[i] - bearing_rad))
        if range_m is None:
            if aside_rad <= HALF_CONE:
                return 0.0
            continue
        far_m = range_m + params.radius_m
        if far_m >= free_m or range_m >= params.sonar_max_m:
            continue
        if kind:
            aside_rad += 0.5 * HALF_CONE if aside_rad > HALF_CONE else 0.0
        else:
            aside_rad -= HALF_CONE if range_m > AFAR_M else 0.5 * HALF_CONE
            aside_rad = max(aside_rad, 0.0)
        if aside_rad < 0.5 * pi and far_m * sin(aside_rad) < room_m:
            free_m = far_m
    return free_m


def follow(boundary: Boundary, pose: Pose, side: int, params: Params) -> None:
    """Start to follow the obstacle in the way, passing it on this side."""
    boundary.following = True
    boundary.met_ticks = 0
    boundary_follower.start(boundary.follower, pose, side, boundary.bearing_rad, params)


def advance(
    boundary: Boundary, pose: Pose, side: int, near_m: float, step_m: float, params: Params
) -> bool:
    """Run one tick along the boundary, or straight on until an obstacle is met.

    Returns False if there is no way to the goal. A boundary met `step_m` nearer than the last,
    measured by the navigator's `near_m`, is a new one; otherwise the previous lap continues.
    """
    if boundary.following:
        return not rounded(boundary, pose)
    if not meets(boundary, params):
        return True
    if is_unreachable(boundary):
        return False
    follow(boundary, pose, side, params)
    anew = near_m < boundary.begun_m - step_m
    if anew:
        boundary.begun_m = near_m
    circle(boundary, pose, anew)
    return True


def circle(boundary: Boundary, pose: Pose, anew: bool) -> None:
    """Start counting laps from here, or continue the previous lap."""
    if anew:
        boundary.laps = 0
        boundary.left_at_nearest = False
        boundary.near_m = inf
        begin(boundary.lap, pose)
    else:
        resume(boundary.lap, pose)
    boundary.hit_at_m = boundary.lap.at_m


def rounded(boundary: Boundary, pose: Pose) -> bool:
    """Update the lap; return whether there were enough laps to give up."""
    marked, mark = boundary.lap.marked, boundary.lap.mark
    boundary.near_m = min(boundary.near_m, boundary.distance_m)
    if closes_lap(boundary.lap, pose):
        boundary.laps += 1
    elif marked and boundary.lap.mark is not mark:
        boundary.near_m = boundary.distance_m
    return boundary.laps >= LAPS


def leave_at_nearest(boundary: Boundary) -> bool:
    """Return True once, at the nearest point of a completed lap without another way to leave.

    Leaving there, as Bug1 does, can find a way that the sonars have not shown.
    """
    if (
        not boundary.laps
        or boundary.left_at_nearest
        or boundary.distance_m > boundary.near_m + AT_M
    ):
        return False
    boundary.left_at_nearest = True
    return True


def is_unreachable(boundary: Boundary) -> bool:
    """Return whether the obstacle is met again and even its nearest point led no nearer."""
    return boundary.left_at_nearest and boundary.distance_m > boundary.near_m - NEARER_M


def leave(boundary: Boundary) -> None:
    """Stop following."""
    boundary.following = False
    boundary.met_ticks = 0


def under_way(boundary: Boundary) -> bool:
    """Return whether the robot has followed the boundary away from where it was met."""
    return boundary.following and boundary.lap.at_m >= boundary.hit_at_m + SETTLE_M


def goal_at_hand(boundary: Boundary, params: Params) -> bool:
    """Return whether the goal is near and the whole way to it is free in view."""
    if boundary.distance_m >= NEAR_GOAL_M or abs(boundary.bearing_rad) > IN_VIEW_RAD:
        return False
    free = free_way_m(boundary.follower, boundary.bearing_rad, params.radius_m, params)
    return free >= boundary.distance_m + params.radius_m


def decision(boundary: Boundary, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Return the decision: along the boundary while following, else at the goal."""
    follower, alpha_rad = boundary.follower, boundary.bearing_rad
    beta_rad, nearest_m = sonar_ring.bearing_rad(ring), ring.nearest_m
    limit_m_s = speed_limit_m_s(ring, params)
    if boundary.following:
        turn_rad = boundary_follower.heading(follower, pose, params)
        if follower.lost:
            leave(boundary)
        elif follower.boxed:
            limit_m_s = 0.0
    if not boundary.following:
        branch = states.TO_GOAL
        return Decision(branch, beta_rad, nearest_m, alpha_rad, 0.0, goal.x_m, goal.y_m, limit_m_s)
    cosine, sine = cos_sin(pose.heading_rad + turn_rad)
    return Decision(
        states.PASS_LEFT if follower.side == states.LEFT else states.PASS_RIGHT,
        beta_rad,
        nearest_m,
        alpha_rad,
        wrap(turn_rad - alpha_rad),
        pose.x_m + boundary.distance_m * cosine,
        pose.y_m + boundary.distance_m * sine,
        limit_m_s,
    )


def is_not_finite(pose: Pose, goal: Goal) -> bool:
    """Return whether pose or goal contain NaN or infinity."""
    total = pose.x_m + pose.y_m + pose.heading_rad + goal.x_m + goal.y_m
    return total - total != 0.0


def halt(ring: Ring, goal: Goal) -> Decision:
    """Return the decision to stop, without a direction."""
    beta_rad = sonar_ring.bearing_rad(ring)
    return Decision(states.TO_GOAL, beta_rad, ring.nearest_m, 0.0, 0.0, goal.x_m, goal.y_m, 0.0)


def give_up(boundary: Boundary, ring: Ring, goal: Goal) -> Decision:
    """Return the decision that the goal is unreachable."""
    beta_rad, alpha_rad = sonar_ring.bearing_rad(ring), boundary.bearing_rad
    return Decision(
        states.GIVE_UP, beta_rad, ring.nearest_m, alpha_rad, 0.0, goal.x_m, goal.y_m, 0.0
    )


def speed_limit_m_s(ring: Ring, params: Params) -> float:
    """Return the speed limit: at least TIME_S to STOP_M from any echo.

    Without a measurement ahead, and beside a wall, the robot creeps.
    """
    limit_m_s = params.v_max_m_s
    for i in EVERY:
        range_m = ring.range_m[i]
        if range_m is None:
            if i in AHEAD:
                limit_m_s = min(limit_m_s, CREEP_M_S)
            continue
        if range_m < limit_m_s * CLOSING[i] * TIME_S + STOP_M:
            may_m_s = max((range_m - STOP_M) / (TIME_S * CLOSING[i]), 0.0)
            if i < 2 or i > SONARS - 3:
                may_m_s = max(may_m_s, CREEP_M_S)
            limit_m_s = min(limit_m_s, may_m_s)
    return limit_m_s


GOING: Final = 0
CIRCLING: Final = 1
RETURNING: Final = 2

BUG1_AT_M: Final = 0.12
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
    if is_not_finite(pose, goal):
        return halt(ring, goal)
    if look(boundary, pose, ring, goal, params):
        memory.phase, memory.left_m, memory.tries = GOING, inf, 0
    if not boundary.following:
        memory.phase = GOING
    if memory.phase == GOING:
        if meets(boundary, params) and not meet(memory, pose, params):
            return give_up(boundary, ring, goal)
    elif under_way(boundary) and goal_at_hand(boundary, params):
        leave_bug1(memory)
    elif memory.phase == CIRCLING:
        circle_bug1(memory, pose)
    else:
        come_back(memory, pose)
    return decision(boundary, pose, ring, goal, params)


def meet(memory: Bug1Memory, pose: Pose, params: Params) -> bool:
    """Start to circle the obstacle; return False if that was done without success before."""
    boundary = memory.boundary
    if boundary.distance_m < memory.left_m - NEARER_M:
        memory.tries = 0
    else:
        memory.tries += 1
        if memory.tries >= TRIES:
            return False
    follow(boundary, pose, memory.side, params)
    memory.phase = CIRCLING
    memory.nearest, memory.nearest_m, memory.nearest_at_m = pose, boundary.distance_m, 0.0
    circle(boundary, pose, True)
    return True


def circle_bug1(memory: Bug1Memory, pose: Pose) -> None:
    """Note the nearest point; after a full lap return to it by the shorter way."""
    boundary, lap = memory.boundary, memory.boundary.lap
    if boundary.distance_m < memory.nearest_m:
        memory.nearest, memory.nearest_m = pose, boundary.distance_m
        memory.nearest_at_m = lap.at_m
    marked, mark = lap.marked, lap.mark
    closed = closes_lap(lap, pose)
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
        begin(lap, pose)


def come_back(memory: Bug1Memory, pose: Pose) -> None:
    """Leave at the nearest point, or after the distance at which it should have been reached."""
    boundary, lap = memory.boundary, memory.boundary.lap
    closes_lap(lap, pose)
    here = apart_m(pose, memory.nearest) <= BUG1_AT_M
    if here or boundary.distance_m <= memory.nearest_m or lap.at_m > memory.return_m:
        leave_bug1(memory)


def leave_bug1(memory: Bug1Memory) -> None:
    """Leave the boundary and head for the goal."""
    memory.left_m = min(memory.left_m, memory.nearest_m)
    memory.phase = GOING
    leave(memory.boundary)


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
    if is_not_finite(pose, goal):
        return halt(ring, goal)
    if look(boundary, pose, ring, goal, params):
        memory.start_x_m, memory.start_y_m = pose.x_m, pose.y_m
    crossed = crosses(memory, pose, goal)
    if under_way(boundary) and leaves_bug2(boundary, crossed, params):
        leave(boundary)
    elif not advance(boundary, pose, memory.side, boundary.distance_m, NEARER_M, params):
        return give_up(boundary, ring, goal)
    return decision(boundary, pose, ring, goal, params)


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
    if goal_at_hand(boundary, params) or leave_at_nearest(boundary):
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
    if is_not_finite(pose, goal):
        return halt(ring, goal)
    look(boundary, pose, ring, goal, params)
    if not boundary.following:
        memory.open_ticks = 0
    if under_way(boundary) and leaves_distbug(memory, params):
        leave(boundary)
    elif not advance(boundary, pose, memory.side, boundary.best_m, STEP_M, params):
        return give_up(boundary, ring, goal)
    return decision(boundary, pose, ring, goal, params)


def leaves_distbug(memory: DistBugMemory, params: Params) -> bool:
    """Return whether leaving leads nearer to the goal than the robot has ever been."""
    boundary = memory.boundary
    memory.open_ticks = memory.open_ticks + 1 if leads_nearer(boundary, params) else 0
    if memory.open_ticks >= SURE_TICKS:
        return True
    return goal_at_hand(boundary, params) or leave_at_nearest(boundary)


def leads_nearer(boundary: Boundary, params: Params) -> bool:
    """Return whether the free distance, less that to stop and turn, leads nearer than ever."""
    if abs(boundary.bearing_rad) > IN_VIEW_RAD:
        return False
    room_m = params.radius_m + STRIP_M
    far_m = free_way_m(boundary.follower, boundary.bearing_rad, room_m, params)
    free_m = min(far_m, params.sonar_max_m) - SHORT_M - params.radius_m
    return boundary.distance_m - max(free_m, 0.0) <= boundary.best_m - STEP_M
