"""The Virtual Goal Method of the paper (section 5) with corrected signs, without a memory.

Paper to code: beta is `nearest_bearing_rad` (here positive to the left), alpha `goal_bearing_rad`,
gamma `rotation_rad`, X_d the goal, X_v the virtual goal, d_obs `params.d_obs_m`. The goal is
rotated about the robot, not about the origin, until the way to it is tangent to the nearest
obstacle.
"""

from math import inf, pi

from robot.core import states
from robot.core.geometry import wrap
from robot.core.navigators.memory.paper_memory import Memory
from robot.core.parameters import Params
from robot.core.perception import sonar_ring as rings
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Decision, Goal, Pose
from runtime.elementary import atan2, cos_sin


def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Return where to drive: at the goal, or past the nearest echo in the avoidance zone."""
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    alpha_rad = wrap(atan2(dy_m, dx_m) - pose.heading_rad)
    beta_rad, nearest_m = rings.bearing_rad(ring), ring.nearest_m
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
