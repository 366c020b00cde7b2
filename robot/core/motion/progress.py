"""Giving up: the robot has not moved although it tries to, or has come no closer for too long."""

from math import inf

from robot.core import reasons
from robot.core.geometry import wrap
from robot.core.parameters import Params
from robot.core.values import Pose


class Progress:
    """Where and when the robot last got away from where it was, and its best distance so far."""

    __slots__ = ("anchor", "best_m", "best_ms", "moved_ms")

    def __init__(self) -> None:
        self.anchor = Pose(0.0, 0.0, 0.0)
        self.moved_ms = self.best_ms = 0
        self.best_m = inf


def restart(progress: Progress, pose: Pose, now_ms: int) -> None:
    """Start judging afresh: a new goal, a new stretch of the trail, or the end of a hold."""
    progress.anchor = pose
    progress.best_m = inf
    progress.moved_ms = progress.best_ms = now_ms


def judge(
    progress: Progress,
    pose: Pose,
    distance_m: float,
    now_ms: int,
    params: Params,
    patient: bool = False,
) -> int:
    """BLOCKED, NO_PROGRESS, or 0 while the robot gets anywhere.

    `patient`: going far away and back is the navigator's business, only not moving is not.
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
    """Far enough from the anchor, or turned far enough away."""
    dx_m, dy_m = pose.x_m - anchor.x_m, pose.y_m - anchor.y_m
    if dx_m * dx_m + dy_m * dy_m >= params.stuck_m * params.stuck_m:
        return True
    return abs(wrap(pose.heading_rad - anchor.heading_rad)) >= params.stuck_rad
