"""Detect a blocked robot, and a lack of progress towards the goal."""

from math import inf

from robot.core import reasons
from robot.core.geometry import wrap
from robot.core.parameters import Params
from robot.core.values import Pose


class ProgressMonitor:
    """Place and time of the last real motion, and the shortest distance to the goal so far."""

    __slots__ = ("anchor", "best_m", "best_ms", "moved_ms")

    def __init__(self) -> None:
        self.anchor = Pose(0.0, 0.0, 0.0)
        self.moved_ms = self.best_ms = 0
        self.best_m = inf


def restart(progress: ProgressMonitor, pose: Pose, now_ms: int) -> None:
    """Restart the timers: for a new goal, a new part of the trail, or after a hold."""
    progress.anchor = pose
    progress.best_m = inf
    progress.moved_ms = progress.best_ms = now_ms


def judge(
    progress: ProgressMonitor,
    pose: Pose,
    distance_m: float,
    now_ms: int,
    params: Params,
    patient: bool = False,
) -> int:
    """Return BLOCKED, NO_PROGRESS, or 0.

    `patient`: the navigator detects a lack of progress itself; only BLOCKED is returned.
    """
    if distance_m < progress.best_m - params.progress_m:
        progress.best_m = distance_m
        progress.best_ms = now_ms
    if got_away(progress.anchor, pose, params):
        progress.anchor = pose
        progress.moved_ms = now_ms
    if now_ms - progress.moved_ms > params.stuck_ms:
        return reasons.BLOCKED
    if not patient and now_ms - progress.best_ms > params.progress_ms:
        return reasons.NO_PROGRESS
    return reasons.OK


def got_away(anchor: Pose, pose: Pose, params: Params) -> bool:
    """Return whether the robot has moved or turned far enough from the anchor."""
    dx_m, dy_m = pose.x_m - anchor.x_m, pose.y_m - anchor.y_m
    if dx_m * dx_m + dy_m * dy_m >= params.stuck_m * params.stuck_m:
        return True
    return abs(wrap(pose.heading_rad - anchor.heading_rad)) >= params.stuck_rad
