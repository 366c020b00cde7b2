"""Distance to the nearest static surface, computed in every tick.

Between nearby positions most surfaces cannot become the nearest one. The candidates are therefore
cached while the robot stays near the position of the last search.
"""

from collections.abc import Sequence
from math import inf, sqrt
from typing import Final, TypeAlias

from plant.model.types import Point
from runtime.elementary import hypot

NEAR_M: Final = 0.15
"""Radius around the position of a search in which its result is valid."""

FURTHER_M: Final = 2.0 * NEAR_M
"""Surfaces farther than the nearest one by more than this stay farther within NEAR_M."""

Round: TypeAlias = tuple[float, float, float]
"""x_m, y_m, radius_m."""

Bar: TypeAlias = tuple[float, float, float, float, float]
"""From x_m, y_m to x_m, y_m, and the distance of its surface from that line."""


class Nearby:
    """The candidates for the nearest surface near a position, and the distance to them.

    The order of sums and products is that of Chipmunk, so the results are bit-identical.
    """

    __slots__ = ("_at", "_bars", "_rounds")

    def __init__(self) -> None:
        self._at = (inf, inf)
        self._rounds: Sequence[Round] = ()
        self._bars: Sequence[Bar] = ()

    def holds(self, at: Point) -> bool:
        """Return whether the cache is valid for a position."""
        return hypot(at[0] - self._at[0], at[1] - self._at[1]) <= NEAR_M

    def remember(self, at: Point, rounds: Sequence[Round], bars: Sequence[Bar]) -> None:
        """Store the surfaces that are at most FURTHER_M farther away than the nearest one."""
        self._at, self._rounds, self._bars = at, rounds, bars

    def distance_m(self, at: Point) -> float:
        """Return the distance from a nearby point, below 0 inside; inf without a surface."""
        x_m, y_m = at
        nearest_m = inf
        for centre_x_m, centre_y_m, radius_m in self._rounds:
            off_x_m, off_y_m = x_m - centre_x_m, y_m - centre_y_m
            away_m = sqrt(off_x_m * off_x_m + off_y_m * off_y_m) - radius_m
            if away_m < nearest_m:
                nearest_m = away_m
        for bar in self._bars:
            away_m = _from_bar_m(x_m, y_m, bar)
            if away_m < nearest_m:
                nearest_m = away_m
        return nearest_m


def _from_bar_m(x_m: float, y_m: float, bar: Bar) -> float:
    ax_m, ay_m, bx_m, by_m, radius_m = bar
    back_x_m, back_y_m = ax_m - bx_m, ay_m - by_m
    dot_m2 = back_x_m * (x_m - bx_m) + back_y_m * (y_m - by_m)
    share = dot_m2 / (back_x_m * back_x_m + back_y_m * back_y_m)
    if share > 1.0:
        share = 1.0
    elif not share > 0.0:
        share = 0.0
    off_x_m, off_y_m = x_m - (bx_m + back_x_m * share), y_m - (by_m + back_y_m * share)
    return sqrt(off_x_m * off_x_m + off_y_m * off_y_m) - radius_m
