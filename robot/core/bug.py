"""The bug algorithm of the paper (section 4): turn to the user's side, follow, leave when open."""

from math import atan2

from robot.core import ring as rings
from robot.core import states
from robot.core.geometry import wrap
from robot.core.memory import Memory
from robot.core.parameters import Params
from robot.core.ring import Ring
from robot.core.values import Decision, Goal, Pose


def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Where to drive now: at the goal, or along the wall on the side away from `memory.side`."""
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    alpha_rad = wrap(atan2(dy_m, dx_m) - pose.heading_rad)
    return Decision(
        states.TO_GOAL,
        rings.bearing_rad(ring),
        ring.nearest_m,
        alpha_rad,
        0.0,
        goal.x_m,
        goal.y_m,
    )
