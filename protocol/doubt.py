"""Doubt about a position: the size of the confidence ellipse of an estimate."""

from math import isfinite, sqrt
from typing import Final

from protocol.wire.messages import PlanarOdometry

OUTSIDE: Final = 0.05
"""The probability that the true position is outside the ellipse."""

CHI2_2: Final = 5.991464547107982
"""The squared half axis in standard deviations: chi-square with two degrees of freedom.

It is -2 log(OUTSIDE), written out because the last bit of a logarithm differs between machines.
"""


def doubt_m(xx_m2: float, xy_m2: float, yy_m2: float) -> float | None:
    """Return the longer half axis of the ellipse in metres; None when this is no covariance."""
    middle_m2, spread_m2 = xx_m2 / 2.0 + yy_m2 / 2.0, xx_m2 / 2.0 - yy_m2 / 2.0
    most_m2 = middle_m2 + sqrt(spread_m2 * spread_m2 + xy_m2 * xy_m2)
    if not isfinite(most_m2) or most_m2 < 0.0:
        return None
    return sqrt(CHI2_2 * most_m2)


def doubt_of(pose: PlanarOdometry) -> float | None:
    """Return the doubt of an estimated pose in metres; None when its place is unknown."""
    return doubt_m(pose.cov_xx_m2, pose.cov_xy_m2, pose.cov_yy_m2)


def doubt_words(doubt_m: float | None) -> str:
    """Return the doubt in words."""
    return f"position doubt {'unknown' if doubt_m is None else f'{doubt_m:.2f} m'}"
