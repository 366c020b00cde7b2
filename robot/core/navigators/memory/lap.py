"""Detect a full lap: the same place in the same direction.

The place alone proves nothing: the robot passes a corridor in both directions.
"""

from math import pi, sqrt
from typing import Final

from robot.core.geometry import wrap
from robot.core.values import Pose

MARK_AFTER_M: Final = 0.35  # at the hit itself the robot is still turning
CLOSE_M: Final = 0.25
SAME_WAY_RAD: Final = pi / 3.0
ROUND_RAD: Final = 300.0 * pi / 180.0
MIN_LAP_M: Final = 0.5
WOUND_RAD: Final = 4.0 * pi  # without passing the mark: it is on another boundary
SPUN_RAD: Final = 6.0 * pi  # boxed in


class Lap:
    """The mark, and distance and turn since then; `at_m` is the distance along the boundary."""

    __slots__ = ("at_m", "last", "mark", "mark_at_m", "marked", "turned_rad")

    def __init__(self) -> None:
        self.mark = self.last = Pose(0.0, 0.0, 0.0)
        self.marked = False
        self.at_m = self.mark_at_m = self.turned_rad = 0.0


def begin(lap: Lap, pose: Pose) -> None:
    """Count from here."""
    lap.last = pose
    lap.marked = False
    lap.at_m = lap.turned_rad = 0.0


def resume(lap: Lap, pose: Pose) -> None:
    """Continue after leaving the boundary; the distance in between does not count."""
    lap.turned_rad += wrap(pose.heading_rad - lap.last.heading_rad)
    lap.last = pose


def closed(lap: Lap, pose: Pose) -> bool:
    """Add one tick along the boundary; return True each time the mark is passed again."""
    lap.at_m += apart_m(lap.last, pose)
    lap.turned_rad += wrap(pose.heading_rad - lap.last.heading_rad)
    lap.last = pose
    spun = abs(lap.turned_rad) >= SPUN_RAD
    if not lap.marked:
        if lap.at_m >= MARK_AFTER_M or spun:
            mark(lap, pose)
            return spun
        return False
    if abs(lap.turned_rad) < ROUND_RAD:
        return False
    if not spun and lap.at_m - lap.mark_at_m < MIN_LAP_M:
        return False
    same_way = abs(wrap(pose.heading_rad - lap.mark.heading_rad)) <= SAME_WAY_RAD
    if not same_way or apart_m(lap.mark, pose) > CLOSE_M:
        if abs(lap.turned_rad) > WOUND_RAD:
            mark(lap, pose)
        return False
    lap.turned_rad = 0.0
    return True


def mark(lap: Lap, pose: Pose) -> None:
    """Set the mark: passing it again in the same direction completes a lap."""
    lap.mark = pose
    lap.mark_at_m = lap.at_m
    lap.marked = True
    lap.turned_rad = 0.0


def apart_m(one: Pose, other: Pose) -> float:
    """Return the distance between two poses."""
    dx_m, dy_m = one.x_m - other.x_m, one.y_m - other.y_m
    return sqrt(dx_m * dx_m + dy_m * dy_m)
