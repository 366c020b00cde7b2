"""The trail for the way back: at most 128 points, every second one removed when full."""

from math import sqrt
from typing import Final

SPACING_M: Final = 0.25
LIMIT: Final = 128
PASSED_M: Final = 0.20


class Trail:
    """Points from the start, the newest last; the spacing doubles each time they are thinned.

    The first `count` items of the lists are used. The lists never grow: on a microcontroller the
    free memory may lack a block for a longer one.
    """

    __slots__ = ("count", "spacing_m", "xs_m", "ys_m")

    def __init__(self) -> None:
        self.count = 0
        self.xs_m = [0.0] * LIMIT
        self.ys_m = [0.0] * LIMIT
        self.spacing_m = SPACING_M


def drop_crumb(trail: Trail, x_m: float, y_m: float) -> None:
    """Store this place if the newest point is a spacing away."""
    if trail.count and distance_m(trail, x_m, y_m) < trail.spacing_m:
        return
    if trail.count >= LIMIT:
        thin(trail)
    trail.xs_m[trail.count] = x_m
    trail.ys_m[trail.count] = y_m
    trail.count += 1


def thin(trail: Trail) -> None:
    """Keep the start and every second point after it."""
    trail.count = (trail.count + 1) // 2
    for i in range(trail.count):
        trail.xs_m[i] = trail.xs_m[2 * i]
        trail.ys_m[i] = trail.ys_m[2 * i]
    trail.spacing_m *= 2.0


def distance_m(trail: Trail, x_m: float, y_m: float) -> float:
    """Return the distance to the newest point."""
    dx_m = x_m - trail.xs_m[trail.count - 1]
    dy_m = y_m - trail.ys_m[trail.count - 1]
    return sqrt(dx_m * dx_m + dy_m * dy_m)


def pass_crumb(trail: Trail, x_m: float, y_m: float) -> bool:
    """Remove the newest point when it is reached; return whether there is a new one.

    The start stays.
    """
    if trail.count < 2 or distance_m(trail, x_m, y_m) > PASSED_M:
        return False
    trail.count -= 1
    return True
