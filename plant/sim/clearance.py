"""The distance to the nearest surface that stands still, asked anew at every tick.

From one place to the next most surfaces cannot have become the nearest one. So those that can are
remembered for as long as the one who asks stays near the place where they were looked up.
"""

from collections.abc import Sequence
from math import hypot, inf, sqrt
from typing import Final, TypeAlias

from plant.model.types import Point

NEAR_M: Final = 0.15
"""What was looked up holds within so much of that place."""

FURTHER_M: Final = 2.0 * NEAR_M
"""What is further away than the nearest surface by more than this is not needed before that."""

Round: TypeAlias = tuple[float, float, float]
"""x_m, y_m, radius_m."""

Bar: TypeAlias = tuple[float, float, float, float, float]
"""From x_m, y_m to x_m, y_m, and how far its surface is away from that line."""


class Nearby:
    """What can be the nearest surface near a place, and how far it is: to the last bit what
    Chipmunk says, whose order of sums and products this keeps."""

    __slots__ = ("_at", "_bars", "_rounds")

    def __init__(self) -> None:
        self._at = (inf, inf)
        self._rounds: Sequence[Round] = ()
        self._bars: Sequence[Bar] = ()

    def holds(self, at: Point) -> bool:
        return hypot(at[0] - self._at[0], at[1] - self._at[1]) <= NEAR_M

    def remember(self, at: Point, rounds: Sequence[Round], bars: Sequence[Bar]) -> None:
        """Everything that is not FURTHER_M further away from there than what is nearest."""
        self._at, self._rounds, self._bars = at, rounds, bars

    def distance_m(self, at: Point) -> float:
        """From a point near that place, below 0 inside; inf when nothing was there."""
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
