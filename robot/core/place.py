"""The place of the robot in the world: known from the start, lost, and set by an operator.

A robot is started with the pose at which its encoders had certain totals. Other totals in the first
sample mean that the wheels have turned since, so the start pose is no longer valid.
"""

from robot.core import modes, reasons, states
from robot.core.motion import Trail
from robot.core.perception.odometry import Odometry
from robot.core.perception.people import Pedestrians
from robot.core.perception.wall_heading import WallHeading
from robot.core.ring import SONARS
from robot.core.state import State
from robot.core.values import Pose, Wheels, wrap


def is_at_start(odometry: Odometry, wheels: Wheels) -> bool:
    """Return whether the first sample has the totals that belong to the start pose."""
    return wheels.left == odometry.left and wheels.right == odometry.right


def set_pose(state: State, pose: Pose) -> int:
    """Move the estimate to a pose that an operator has given; return a reason, 0 if done.

    A NaN heading keeps the present one, which a robot without a place does not have. The trail
    restarts, because its points belong to the old estimate; so do the tracks of pedestrians and
    the directions of walls.
    """
    machine, odometry = state.machine, state.odometry
    if machine.vehicle == states.BOOT:
        return reasons.NO_SENSES
    if modes.goal_is_active(machine):
        return reasons.DRIVING
    x_m, y_m, heading_rad = pose
    if heading_rad != heading_rad:
        if not machine.placed:
            return reasons.PLACE_UNKNOWN
        heading_rad = odometry.pose.heading_rad
    far_m = machine.goal_max_m
    if not (-far_m <= x_m <= far_m and -far_m <= y_m <= far_m and -1e3 <= heading_rad <= 1e3):
        return reasons.PARAMETER_OUT_OF_RANGE
    odometry.pose = Pose(x_m, y_m, wrap(heading_rad))
    odometry.pxx = odometry.pyy = odometry.grain_m2
    odometry.pxy = odometry.pxh = odometry.pyh = 0.0
    odometry.phh = odometry.grain_rad2
    odometry.bend_x_m = odometry.bend_y_m = 0.0
    state.trail = Trail()
    state.walls = WallHeading()
    state.ring.pedestrians = Pedestrians()
    state.ring.approach_m_s = [0.0] * SONARS
    machine.placed = True
    return reasons.OK
