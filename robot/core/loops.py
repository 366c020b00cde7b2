"""Notices that the robot has been here before: hits remembered by place, the way by its crumbs.

A loop is the same places in the same order in the same direction; the place alone would take the
two sides of a corridor for one.
"""

from math import pi

from robot.core.typed import Final
from robot.core.values import Pose

HITS: Final = 16
HIT_MM: Final = 350
CRUMBS: Final = 160
SPACING_MM: Final = 250
SAME_MM: Final = 250
LEAST_AWAY: Final = 5
"""Crumbs that must lie between a place and its second visit."""
IN_A_ROW: Final = 3
SAME_RAD: Final = 50.0 * pi / 180.0
TWO_PI: Final = 2.0 * pi


class Loops:
    """Rings of hits (place and side) and crumbs (place and heading); the oldest are overwritten."""

    __slots__ = (
        "crumb_rad",
        "crumb_x_mm",
        "crumb_y_mm",
        "crumbs",
        "first",
        "hit_side",
        "hit_x_mm",
        "hit_y_mm",
        "hits",
        "matches",
    )

    def __init__(self) -> None:
        self.hit_x_mm = [0] * HITS
        self.hit_y_mm = [0] * HITS
        self.hit_side = [0] * HITS
        self.hits = 0
        self.crumb_x_mm = [0] * CRUMBS
        self.crumb_y_mm = [0] * CRUMBS
        self.crumb_rad = [0.0] * CRUMBS
        self.crumbs = 0
        self.matches = 0
        self.first = 0


def restart(loops: Loops) -> None:
    """Forget the way."""
    loops.crumbs = 0
    loops.matches = 0


def hit(loops: Loops, pose: Pose, side: int) -> int:
    """The side to pass on: the wanted one, unless the last hit here was passed on that side."""
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    for k in range(loops.hits - 1, max(loops.hits - HITS, 0) - 1, -1):
        dx_mm, dy_mm = loops.hit_x_mm[k % HITS] - x_mm, loops.hit_y_mm[k % HITS] - y_mm
        if dx_mm * dx_mm + dy_mm * dy_mm < HIT_MM * HIT_MM:
            side = -loops.hit_side[k % HITS]
            break
    k = loops.hits % HITS
    loops.hit_x_mm[k], loops.hit_y_mm[k], loops.hit_side[k] = x_mm, y_mm, side
    loops.hits += 1
    restart(loops)
    return side


def drop(loops: Loops, pose: Pose) -> bool:
    """Drop a crumb every so often; whether the way has closed upon itself."""
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    if loops.crumbs:
        k = (loops.crumbs - 1) % CRUMBS
        dx_mm, dy_mm = loops.crumb_x_mm[k] - x_mm, loops.crumb_y_mm[k] - y_mm
        if dx_mm * dx_mm + dy_mm * dy_mm < SPACING_MM * SPACING_MM:
            return False
    again = False
    first = 0
    for k in range(max(loops.crumbs - CRUMBS, 0), loops.crumbs - LEAST_AWAY):
        i = k % CRUMBS
        dx_mm = loops.crumb_x_mm[i] - x_mm
        if -SAME_MM < dx_mm < SAME_MM:
            dy_mm = loops.crumb_y_mm[i] - y_mm
            off_rad = (loops.crumb_rad[i] - pose.heading_rad + pi) % TWO_PI - pi
            if dx_mm * dx_mm + dy_mm * dy_mm < SAME_MM * SAME_MM and -SAME_RAD < off_rad < SAME_RAD:
                again = True
                first = k
                break
    loops.matches = loops.matches + 1 if again else 0
    loops.first = first
    k = loops.crumbs % CRUMBS
    loops.crumb_x_mm[k], loops.crumb_y_mm[k] = x_mm, y_mm
    loops.crumb_rad[k] = pose.heading_rad
    loops.crumbs += 1
    return loops.matches >= IN_A_ROW


def turns_left(loops: Loops) -> bool:
    """Whether the loop that closed goes round counter-clockwise; by the sign of its area."""
    twice = 0.0
    for k in range(loops.first, loops.crumbs):
        i, j = k % CRUMBS, (k + 1) % CRUMBS if k + 1 < loops.crumbs else loops.first % CRUMBS
        twice += loops.crumb_x_mm[i] * loops.crumb_y_mm[j] * 1e-6
        twice -= loops.crumb_x_mm[j] * loops.crumb_y_mm[i] * 1e-6
    return twice > 0.0


def encloses(loops: Loops, x_m: float, y_m: float) -> bool:
    """Whether a place lies within the loop that closed."""
    x_mm, y_mm = 1000.0 * x_m, 1000.0 * y_m
    inside = False
    for k in range(loops.first, loops.crumbs):
        i, j = k % CRUMBS, (k + 1) % CRUMBS if k + 1 < loops.crumbs else loops.first % CRUMBS
        y1, y2 = loops.crumb_y_mm[i] - y_mm, loops.crumb_y_mm[j] - y_mm
        if (y1 > 0.0) != (y2 > 0.0):
            x1, x2 = loops.crumb_x_mm[i] - x_mm, loops.crumb_x_mm[j] - x_mm
            if x1 + (x2 - x1) * y1 / (y1 - y2) > 0.0:
                inside = not inside
    return inside
