"""Compute the ellipse that contains the robot with probability 1 - OUTSIDE."""

from math import atan2, isfinite, log, sqrt
from typing import Final

OUTSIDE: Final = 0.05
"""The probability that the robot is outside the ellipse."""
CHI2_2: Final = -2.0 * log(OUTSIDE)
"""The squared half axis in standard deviations: chi-square with two degrees of freedom."""


def ellipse(covariance: tuple[float, float, float]) -> tuple[float, float, float] | None:
    """Return the half axes in metres, the longer first, and its direction in radians.

    `covariance` is xx, xy, yy in m2. Return None when these are not a covariance.
    """
    xx, xy, yy = covariance
    middle, spread = xx / 2.0 + yy / 2.0, xx / 2.0 - yy / 2.0
    half = sqrt(spread * spread + xy * xy)
    if not (isfinite(middle) and isfinite(half)) or middle + half < 0.0:
        return None
    long_m = sqrt(CHI2_2 * (middle + half))
    short_m = sqrt(CHI2_2 * max(0.0, middle - half))
    return long_m, short_m, 0.5 * atan2(2.0 * xy, xx - yy) if half > 0.0 else 0.0
