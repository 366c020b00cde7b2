"""The ellipse that holds the robot with a chance of 95 %."""

from math import atan2, isfinite, sqrt
from typing import Final

CHI2_2_95: Final = 5.991464547107979
"""The square of its half axis in standard deviations: chi-square with two degrees of freedom."""


def ellipse(covariance: tuple[float, float, float]) -> tuple[float, float, float] | None:
    """Half axes in metres, the longer first, and its direction; None for no covariance at all."""
    xx, xy, yy = covariance
    middle, spread = xx / 2.0 + yy / 2.0, xx / 2.0 - yy / 2.0
    half = sqrt(spread * spread + xy * xy)
    if not (isfinite(middle) and isfinite(half)) or middle + half < 0.0:
        return None
    long_m = sqrt(CHI2_2_95 * (middle + half))
    short_m = sqrt(CHI2_2_95 * max(0.0, middle - half))
    return long_m, short_m, 0.5 * atan2(2.0 * xy, xx - yy) if half > 0.0 else 0.0
