"""One square of a calibration: its encoder counters and its measured end."""

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
from runtime.timing import PERIOD_MS

CW: Final = "cw"
CCW: Final = "ccw"
DIRECTIONS: Final = (CW, CCW)

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class SquareRun:
    """The encoder counters (left, right) of one square, from the start, at each control period.

    `measured` is the pose at the end relative to the start: x forward, y left, heading.
    """

    direction: str
    ticks: Sequence[tuple[int, int]]
    measured: Pose


def believed(run: SquareRun, params: Params) -> Odometry:
    """Return the core's odometry after the ticks of a run with these parameters."""
    odometry = Odometry()
    for k, (left, right) in enumerate(run.ticks):
        odometries.update(odometry, Wheels(left, right, 0, k * PERIOD_MS), params)
    return odometry


def error_of(run: SquareRun, odometry: Odometry) -> Array:
    """Return measured minus estimated x, y, heading (the paper's return position errors)."""
    measured, pose = run.measured, odometry.pose
    turn_rad = wrap(measured.heading_rad - pose.heading_rad)
    return np.array([measured.x_m - pose.x_m, measured.y_m - pose.y_m, turn_rad])


def errors_of(runs: Iterable[SquareRun], params: Params) -> Array:
    """Return the errors of the runs, shape (runs, 3)."""
    return np.array([error_of(run, believed(run, params)) for run in runs]).reshape(-1, 3)


def covariance_of(odometry: Odometry) -> Array:
    """Return the 3x3 covariance of an odometry."""
    o = odometry
    return np.array([[o.pxx, o.pxy, o.pxh], [o.pxy, o.pyy, o.pyh], [o.pxh, o.pyh, o.phh]])
