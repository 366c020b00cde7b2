"""Distance to the static surfaces near a robot, computed in every tick.

Between nearby positions most surfaces can neither become the nearest one nor be touched. The
candidates are therefore cached while the robot stays near the position of the last search.
"""

from collections.abc import Sequence
from math import inf, sqrt
from typing import Final, NamedTuple

from plant.model.types import Point

NEAR_M: Final = 0.15
"""Radius around the position of a search in which its result is valid."""

FURTHER_M: Final = 2.0 * NEAR_M
"""Surfaces farther than the nearest one by more than this stay farther within NEAR_M."""


class Surface(NamedTuple):
    """The points at a distance from a line, which starts at x_m, y_m; a disc has no line.

    `per_m2` is the inverse of the line's squared length, 0 without a line.
    """

    x_m: float
    y_m: float
    along_x_m: float
    along_y_m: float
    per_m2: float
    radius_m: float

    def offset_m(self, x_m: float, y_m: float) -> Point:
        """Return the vector from a point to the nearest point of the line."""
        start_x_m, start_y_m, along_x_m, along_y_m, per_m2, _ = self
        off_x_m, off_y_m = start_x_m - x_m, start_y_m - y_m
        share = -(off_x_m * along_x_m + off_y_m * along_y_m) * per_m2
        if share > 1.0:
            share = 1.0
        elif not share > 0.0:
            share = 0.0
        return off_x_m + share * along_x_m, off_y_m + share * along_y_m


def line(a: Point, b: Point, radius_m: float) -> Surface:
    """Return the surface around the line from a to b, which may be equal."""
    along_x_m, along_y_m = b[0] - a[0], b[1] - a[1]
    square_m2 = along_x_m * along_x_m + along_y_m * along_y_m
    return Surface(*a, along_x_m, along_y_m, 1.0 / square_m2 if square_m2 else 0.0, radius_m)


class Nearby:
    """The candidates for the nearest surface near a position, and the distance to them."""

    __slots__ = ("_at", "surfaces")

    def __init__(self) -> None:
        self._at = (inf, inf)
        self.surfaces: Sequence[Surface] = ()

    def holds(self, at: Point) -> bool:
        """Return whether the cache is valid for a position."""
        off_x_m, off_y_m = at[0] - self._at[0], at[1] - self._at[1]
        return off_x_m * off_x_m + off_y_m * off_y_m <= NEAR_M * NEAR_M

    def remember(self, at: Point, surfaces: Sequence[Surface]) -> None:
        """Store the surfaces that are at most FURTHER_M farther away than the nearest one."""
        self._at, self.surfaces = at, surfaces

    def distance_m(self, at: Point) -> float:
        """Return the distance from a nearby point, below 0 inside; inf without a surface."""
        x_m, y_m = at
        nearest_m = inf
        for surface in self.surfaces:
            off_x_m, off_y_m = surface.offset_m(x_m, y_m)
            away_m = sqrt(off_x_m * off_x_m + off_y_m * off_y_m) - surface.radius_m
            if away_m < nearest_m:
                nearest_m = away_m
        return nearest_m
