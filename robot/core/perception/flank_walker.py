"""Detect a pedestrian that walks alongside: an echo at one flank that stays there.

A static obstacle that only the last sonar of a flank detects is behind the robot after a short
straight drive. An echo that is still there after a longer one moves alongside, and following it
would follow a person. The robot then turns away and lets it go ahead.

Headings are brads: integers, 4096 to the circle.
"""

from typing import Final

from robot.core.perception.echoes import BRADS, CIRCLE, HALF_CIRCLE
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Pose

NEAR_M: Final = 0.20
BEFORE_M: Final = 0.25  # minimum difference to the range of the sonar before it
ALONG_MM: Final = 350
STRAIGHT: Final = 340  # brads, 30 degrees
GIVE_WAY_TICKS: Final = 60
DRIVE_TICKS: Final = 30
ASIDE: Final = 1080  # brads, 95 degrees


class FlankWalker:
    """Pose of the robot when an echo appeared at one flank only.

    `side` is 1 left, -1 right, 0 none. While `ticks` are left, the robot gives way along `heading`.
    """

    __slots__ = ("began", "heading", "side", "ticks", "x_mm", "y_mm")

    def __init__(self) -> None:
        self.x_mm = self.y_mm = self.began = self.heading = self.ticks = self.side = 0


def watch(flank_walker: FlankWalker, ring: Ring, pose: Pose) -> bool:
    """Update for one tick; return whether a pedestrian has just been detected."""
    side = flank(ring)
    if side == 0:
        flank_walker.side = 0
        return False
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    heading = int(BRADS * pose.heading_rad)
    turned = (heading - flank_walker.began + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
    if side != flank_walker.side or not -STRAIGHT < turned < STRAIGHT:
        flank_walker.side = side
        flank_walker.x_mm, flank_walker.y_mm, flank_walker.began = x_mm, y_mm, heading
        return False
    dx_mm, dy_mm = x_mm - flank_walker.x_mm, y_mm - flank_walker.y_mm
    if dx_mm * dx_mm + dy_mm * dy_mm < ALONG_MM * ALONG_MM:
        return False
    flank_walker.heading = heading - side * ASIDE
    flank_walker.ticks = GIVE_WAY_TICKS
    flank_walker.side = 0
    return True


def flank(ring: Ring) -> int:
    """Return the flank at which only the last sonar has a near echo."""
    if ring.nearest_m >= NEAR_M:
        return 0
    right_m, left_m = ring.range_m[0], ring.range_m[7]
    if right_m is not None and right_m < NEAR_M and is_last(ring.range_m[1], right_m):
        return -1
    if left_m is not None and left_m < NEAR_M and is_last(ring.range_m[6], left_m):
        return 1
    return 0


def is_last(before_m: float | None, range_m: float) -> bool:
    """Return whether the sonar before the last one does not detect the same object."""
    return before_m is not None and before_m > range_m + BEFORE_M
