"""The ellipse that holds the robot with a chance of CHANCE."""

from math import atan2, isfinite, log, sqrt
from typing import Final

OUTSIDE: Final = 0.05
CHANCE: Final = f"{100.0 * (1.0 - OUTSIDE):g} %"
CHI2_2: Final = -2.0 * log(OUTSIDE)
"""The square of its half axis in standard deviations: chi-square with two degrees of freedom."""


def ellipse(covariance: tuple[float, float, float]) -> tuple[float, float, float] | None:
    """Half axes in metres, the longer first, and its direction; None for no covariance at all."""
    xx, xy, yy = covariance
    middle, spread = xx / 2.0 + yy / 2.0, xx / 2.0 - yy / 2.0
    half = sqrt(spread * spread + xy * xy)
    if not (isfinite(middle) and isfinite(half)) or middle + half < 0.0:
        return None
    long_m = sqrt(CHI2_2 * (middle + half))
    short_m = sqrt(CHI2_2 * max(0.0, middle - half))
    return long_m, short_m, 0.5 * atan2(2.0 * xy, xx - yy) if half > 0.0 else 0.0
