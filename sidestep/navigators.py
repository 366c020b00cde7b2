"""What a navigator of your own is written with: its types, and where the goal and an echo are.

    def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
        return towards(goal_bearing_rad(pose, goal), pose, ring, goal)

All lengths are metres and all angles radians, counter-clockwise. A bearing is an angle from the
heading of the robot, positive to the left. `sidestep navigators new NAME` writes a file to begin
with.
"""

from math import inf
from typing import Final

from robot.core import states
from robot.core.parameters import Params
from robot.core.perception.sonar_ring import Ring, bearing_rad
from robot.core.ring import BEARINGS
from robot.core.values import Decision, Goal, Pose, wrap
from robot.own_navigator import Memory
from runtime.elementary import atan2, cos_sin, hypot

__all__ = [
    "BEARINGS",
    "GIVE_UP",
    "LEFT",
    "LOST",
    "PASS_LEFT",
    "PASS_RIGHT",
    "RIGHT",
    "TO_GOAL",
    "Decision",
    "Goal",
    "Memory",
    "Params",
    "Pose",
    "Ring",
    "bearing_rad",
    "goal_bearing_rad",
    "goal_distance_m",
    "towards",
    "wrap",
]

LEFT: Final = states.LEFT
RIGHT: Final = states.RIGHT
TO_GOAL: Final = states.TO_GOAL
PASS_LEFT: Final = states.PASS_LEFT
PASS_RIGHT: Final = states.PASS_RIGHT
GIVE_UP: Final = states.GIVE_UP
LOST: Final = states.LOST


def goal_distance_m(pose: Pose, goal: Goal) -> float:
    """Return the distance to the goal in metres."""
    return hypot(goal.x_m - pose.x_m, goal.y_m - pose.y_m)


def goal_bearing_rad(pose: Pose, goal: Goal) -> float:
    """Return the direction of the goal in radians from the heading."""
    return wrap(atan2(goal.y_m - pose.y_m, goal.x_m - pose.x_m) - pose.heading_rad)


def towards(
    bearing_rad: float, pose: Pose, ring: Ring, goal: Goal, speed_limit_m_s: float = inf
) -> Decision:
    """Return the decision to drive in a direction (radians from the heading), at most so fast.

    The point to drive to is as far away as the goal, so that the robot slows down near it.
    """
    distance_m, goal_rad = goal_distance_m(pose, goal), goal_bearing_rad(pose, goal)
    turn_rad = wrap(bearing_rad - goal_rad)
    passing = PASS_LEFT if turn_rad > 0.0 else PASS_RIGHT
    cosine, sine = cos_sin(pose.heading_rad + goal_rad + turn_rad)
    return Decision(
        branch=passing if turn_rad else TO_GOAL,
        nearest_bearing_rad=BEARINGS[ring.nearest] if ring.nearest >= 0 else None,
        nearest_range_m=ring.nearest_m,
        goal_bearing_rad=goal_rad,
        rotation_rad=turn_rad,
        virtual_x_m=pose.x_m + distance_m * cosine,
        virtual_y_m=pose.y_m + distance_m * sine,
        speed_limit_m_s=speed_limit_m_s,
    )
