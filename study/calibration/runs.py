"""One drive of a calibration: what its wheels counted, and where it ended as measured."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from robot.core.geometry import wrap
from robot.core.parameters import Params
from robot.core.perception import odometry as odometries
from robot.core.perception.odometry import Odometry
from robot.core.values import Pose, Wheels

CW: Final = "cw"
CCW: Final = "ccw"
DIRECTIONS: Final = (CW, CCW)
PERIOD_MS: Final = 50

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """`ticks`: both encoder counters (left, right) from the start on, at every control period.

    `measured` is the pose at the end as the robot stood at the start: x forward, y left, heading.
    """

    direction: str
    ticks: Sequence[tuple[int, int]]
    measured: Pose


def believed(run: Run, params: Params) -> Odometry:
    """What the core's own odometry makes of the ticks with these parameters."""
    odometry = Odometry()
    for k, (left, right) in enumerate(run.ticks):
        odometries.update(odometry, Wheels(left, right, 0, k * PERIOD_MS), params)
    return odometry


def error_of(run: Run, odometry: Odometry) -> Array:
    """Measured minus believed: x, y, heading (the paper's return position errors)."""
    measured, pose = run.measured, odometry.pose
    turn_rad = wrap(measured.heading_rad - pose.heading_rad)
    return np.array([measured.x_m - pose.x_m, measured.y_m - pose.y_m, turn_rad])


def errors_of(runs: Iterable[Run], params: Params) -> Array:
    """One row per run."""
    return np.array([error_of(run, believed(run, params)) for run in runs]).reshape(-1, 3)


def covariance_of(odometry: Odometry) -> Array:
    o = odometry
    return np.array([[o.pxx, o.pxy, o.pxh], [o.pxy, o.pyy, o.pyh], [o.pxh, o.pyh, o.phh]])
