"""The two navigators of the paper: its Virtual Goal Method and its bug algorithm.

The Virtual Goal Method (section 5) has corrected signs and needs no memory but the side. Paper to
code: beta is `nearest_bearing_rad` (here positive to the left), alpha `goal_bearing_rad`, gamma
`rotation_rad`, X_d the goal, X_v the virtual goal, d_obs `params.d_obs_m`. The goal is rotated
about the robot, not about the origin, until the way to it is tangent to the nearest obstacle.

In the bug algorithm (section 4) an obstacle in the way nearer than d_th starts boundary following.
As soon as the way to the goal looks open, the robot heads for the goal again. Earlier obstacles are
forgotten, so deep traps may hold the robot. Obstacles are passed on `memory.side`; the wall is on
the other side.
"""

from math import inf, pi, sqrt
from typing import Final

from robot.core import states
from robot.core.parameters import Params
from robot.core.perception import sonar_ring
from robot.core.perception.sonar_ring import Ring
from robot.core.ring import BEARINGS, HALF_CONE, SONARS
from robot.core.values import EVERY, Decision, Goal, Pose, wrap
from runtime.elementary import atan2, cos, cos_sin, sin


class PaperMemory:
    """State of bug between two ticks.

    `side` is where obstacles are passed. `following` is set while one is followed, and `beside`
    once it is beside the robot. `lost_rad` is the turn since the wall was lost, `heading_rad` the
    last heading.
    """

    __slots__ = ("beside", "following", "heading_rad", "lost_rad", "side")

    def __init__(self) -> None:
        self.side: int = states.LEFT
        self.following = False
        self.beside = False
        self.lost_rad = 0.0
        self.heading_rad = 0.0


def step_vgm(memory: PaperMemory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Return where to drive: at the goal, or past the nearest echo in the avoidance zone."""
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    alpha_rad = wrap(atan2(dy_m, dx_m) - pose.heading_rad)
    beta_rad, nearest_m = sonar_ring.bearing_rad(ring), ring.nearest_m
    if beta_rad is None or nearest_m >= params.d_obs_m:
        branch = states.TO_GOAL
        return Decision(branch, beta_rad, nearest_m, alpha_rad, 0.0, goal.x_m, goal.y_m, inf)
    left = beta_rad > 0.0
    tangent_rad = beta_rad - 0.5 * pi if left else beta_rad + 0.5 * pi
    gamma_rad = wrap(tangent_rad - alpha_rad)
    cosine, sine = cos_sin(gamma_rad)
    return Decision(
        states.PASS_RIGHT if left else states.PASS_LEFT,
        beta_rad,
        nearest_m,
        alpha_rad,
        gamma_rad,
        pose.x_m + cosine * dx_m - sine * dy_m,
        pose.y_m + sine * dx_m + cosine * dy_m,
        inf,
    )


HIT_MARGIN_M: Final = 0.03
LEAVE_MARGIN_M: Final = 0.05
IN_VIEW_RAD: Final = 70.0 * pi / 180.0
LOST_M: Final = 0.15  # a wall this much beyond its distance is lost
LOST_TURN_RAD: Final = 1.5 * pi
WALL_SIDE: Final = 2  # the first three sonars, counted from the wall, face it
STEER_RAD_PER_M: Final = 4.0
STEER_MAX_RAD: Final = 0.6
QUARTER_CONE: Final = 0.5 * HALF_CONE
LEAN_MAX_RAD: Final = 0.4
COS_STEP: Final = cos(2.0 * HALF_CONE)
SIN_STEP: Final = sin(2.0 * HALF_CONE)
BESIDE: Final = 0.5 * pi


def step_bug(memory: PaperMemory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Return where to drive: at the goal, or along the wall on the side away from `memory.side`."""
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    alpha_rad = wrap(atan2(dy_m, dx_m) - pose.heading_rad)
    beta_rad, nearest_m = sonar_ring.bearing_rad(ring), ring.nearest_m
    distance_m = sqrt(dx_m * dx_m + dy_m * dy_m)
    decide(memory, ring, alpha_rad, distance_m, params)
    gamma_rad = 0.0
    if memory.following:
        gamma_rad = along_the_wall(memory, pose, ring, params) - alpha_rad
    memory.heading_rad = pose.heading_rad
    if not memory.following:
        branch = states.TO_GOAL
        return Decision(branch, beta_rad, nearest_m, alpha_rad, 0.0, goal.x_m, goal.y_m, inf)
    cosine, sine = cos_sin(gamma_rad)
    return Decision(
        states.PASS_LEFT if memory.side == states.LEFT else states.PASS_RIGHT,
        beta_rad,
        nearest_m,
        alpha_rad,
        wrap(gamma_rad),
        pose.x_m + cosine * dx_m - sine * dy_m,
        pose.y_m + sine * dx_m + cosine * dy_m,
        inf,
    )


def decide(
    memory: PaperMemory, ring: Ring, alpha_rad: float, distance_m: float, params: Params
) -> None:
    """Start following if an obstacle is in the way; stop when the way is open in view."""
    if not memory.following:
        memory.following = in_the_way(ring, alpha_rad, distance_m, HIT_MARGIN_M, params)
        memory.lost_rad = 0.0
        memory.beside = False
    elif -IN_VIEW_RAD <= alpha_rad <= IN_VIEW_RAD:
        memory.following = in_the_way(ring, alpha_rad, distance_m, LEAVE_MARGIN_M, params)


def in_the_way(
    ring: Ring, alpha_rad: float, distance_m: float, margin_m: float, params: Params
) -> bool:
    """Return whether an echo nearer than d_th lies in the strip swept towards the goal.

    An echo may come from anywhere in its cone. It is assumed halfway from the middle to the edge
    next to the goal. At the edge itself, a wall along the way would seem to obstruct it.
    """
    if ring.nearest_m >= params.d_th_m:
        return False
    for i in EVERY:
        range_m = ring.range_m[i]
        if range_m is None or range_m >= params.d_th_m or range_m >= distance_m:
            continue
        aside_rad = max(abs(wrap(BEARINGS[i] - alpha_rad)) - QUARTER_CONE, 0.0)
        reach_m = range_m + params.radius_m
        if aside_rad < BESIDE and reach_m * sin(aside_rad) < params.radius_m + margin_m:
            return True
    return False


def along_the_wall(memory: PaperMemory, pose: Pose, ring: Ring, params: Params) -> float:
    """Return the bearing along the wall, corrected for its distance; an arc around its end.

    The ring is blind beyond 90 degrees. When the wall ends, the robot turns towards its last place
    by at most three quarters of a turn, then heads for the goal again.
    """
    side = memory.side
    i = wall_sonar(memory, ring, params)
    range_m = ring.range_m[i]
    if range_m is None or range_m > params.follow_m + LOST_M:
        memory.lost_rad += abs(wrap(pose.heading_rad - memory.heading_rad))
        memory.following = memory.lost_rad <= LOST_TURN_RAD
        arc_m = params.follow_m + params.radius_m
        return -side * min(params.v_max_m_s / (params.k_omega * arc_m), 1.0)
    memory.lost_rad = 0.0
    outermost = i in (0, SONARS - 1)
    tangent_rad = BEARINGS[i] + side * BESIDE
    if outermost:
        tangent_rad = side * leaning_rad(range_m, ring.range_m[i + side], params)
    away_rad = STEER_RAD_PER_M * (params.follow_m - range_m)
    return tangent_rad + side * max(-STEER_MAX_RAD, min(STEER_MAX_RAD, away_rad))


def leaning_rad(beside_m: float, before_m: float | None, params: Params) -> float:
    """Return the angle of the robot towards the wall, from the two outermost sonars beside it.

    Along a flat wall the second cone measures a range larger by 1 / cos(22.5 deg). To first order
    this ratio changes with the angle by sin(22.5 deg). Without this term the following would
    oscillate.
    """
    if before_m is None or before_m > beside_m + LOST_M:
        return 0.0
    ratio = (beside_m + params.radius_m) / (before_m + params.radius_m)
    return max(-LEAN_MAX_RAD, min(LEAN_MAX_RAD, (ratio - COS_STEP) / SIN_STEP))


def wall_sonar(memory: PaperMemory, ring: Ring, params: Params) -> int:
    """Return the sonar with the shortest range to the followed wall.

    Once the wall is beside the robot this is one of the three sonars there. An echo ahead then
    counts only if it is as near as the wall, so that a gap behind the wall's end is entered instead
    of mistaken for a wall. Before that, any near echo ahead counts as the obstacle.
    """
    side = memory.side
    wall = 0 if side == states.LEFT else SONARS - 1
    ahead_m = params.follow_m if memory.beside else params.d_th_m
    best, best_m = wall, 1e9
    for k in range(SONARS - 2):
        i = wall + side * k
        range_m = ring.range_m[i]
        if range_m is None or (k > WALL_SIDE and range_m >= ahead_m):
            continue
        if range_m < best_m:
            best, best_m = i, range_m
    if (best - wall) * side <= WALL_SIDE and best_m < params.follow_m + LOST_M:
        memory.beside = True
    return best
