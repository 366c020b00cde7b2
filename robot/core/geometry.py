"""Angles: wrapping, and the bearings of the eight sonars."""

from math import pi
from typing import Final

from robot.core.values import SONARS
from runtime.elementary import cos, cos_sin, sin

TWO_PI: Final = 2.0 * pi

BEARINGS: Final = tuple([(i - 3.5) * pi / 8.0 for i in range(SONARS)])
"""Bearing of each sonar in radians from the heading: 0 is the right one, 7 the left one."""

COSINES: Final = tuple([cos(b) for b in BEARINGS])
SINES: Final = tuple([sin(b) for b in BEARINGS])

HALF_CONE: Final = pi / 16.0


def wrap(angle_rad: float) -> float:
    """Return the same direction in (-pi, pi]; NaN and infinity become NaN."""
    if -pi < angle_rad <= pi:
        return angle_rad
    if angle_rad - angle_rad != 0.0:
        return angle_rad - angle_rad
    wrapped_rad = angle_rad % TWO_PI
    return wrapped_rad - TWO_PI if wrapped_rad > pi else wrapped_rad


def whole_cos_sin(angle_rad: float) -> tuple[int, int]:
    """Return cosine and sine in 1024ths."""
    cosine, sine = cos_sin(angle_rad)
    return int(1024.0 * cosine), int(1024.0 * sine)
