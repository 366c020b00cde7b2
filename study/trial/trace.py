"""A trial as CSV, one line per tick: truth, estimate with covariance, decision, wheels."""

import csv
from math import inf, nan
from typing import TextIO

from plant.sim.simulation import Plant
from robot.core.values import Decision, Outputs
from runtime.units import NS_PER_S
from study.trial.core_loop import CoreLoop

COLUMNS = (
    *("time_s", "true_x_m", "true_y_m", "true_heading_rad", "clearance_m", "contact"),
    *("x_m", "y_m", "heading_rad", "speed_m_s", "yaw_rate_rad_s"),
    *("cov_xx_m2", "cov_xy_m2", "cov_xh_m_rad", "cov_yy_m2", "cov_yh_m_rad", "cov_hh_rad2"),
    "slip_share",
    *("vehicle", "mode", "goal", "goal_distance_m"),
    *("branch", "nearest_bearing_rad", "nearest_range_m", "goal_bearing_rad", "rotation_rad"),
    *("virtual_x_m", "virtual_y_m", "speed_limit_m_s"),
    *("wanted_speed_m_s", "wanted_yaw_rate_rad_s", "left_mrad_s", "right_mrad_s", "guard"),
)
"""Positions are in the world frame. States are numbered as in the dialect."""

UNDECIDED = Decision(0, None, inf, nan, nan, nan, nan, inf)


class Trace:
    """Write one CSV line for each tick of a trial."""

    def __init__(self, file: TextIO) -> None:
        self._writer = csv.writer(file, lineterminator="\n")
        self._writer.writerow(COLUMNS)

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Write the line of this tick."""
        self._writer.writerow((*_truth(plant), *_estimate(onboard), *_choice(onboard, outputs)))


def _truth(plant: Plant) -> tuple[float, ...]:
    truth = plant.truth()
    pose = (truth.x_m, truth.y_m, truth.heading_rad)
    return plant.now_ns / NS_PER_S, *pose, truth.clearance_m, truth.contact


def _estimate(onboard: CoreLoop) -> tuple[float, ...]:
    odometry, machine = onboard.state.odometry, onboard.state.machine
    covariance = (odometry.pxx, odometry.pxy, odometry.pxh, odometry.pyy, odometry.pyh)
    speeds = (odometry.speed_m_s, odometry.yaw_rate_rad_s)
    states = (machine.vehicle, machine.mode, machine.goal_state, onboard.state.goal_distance_m)
    doubts = (odometry.phh, onboard.state.slip.share)
    return *odometry.pose, *speeds, *covariance, *doubts, *states


def _choice(onboard: CoreLoop, outputs: Outputs) -> tuple[float | None, ...]:
    """Return decision, guard and wheel speeds; the bearing is empty if nothing was near."""
    decision = outputs.decision or UNDECIDED
    wheels = (outputs.left_mrad_s, outputs.right_mrad_s)
    return *decision, *outputs.twist, *wheels, outputs.guard
