"""Moving obstacles: back and forth along their waypoints, at constant speed, unstoppable."""

from itertools import accumulate, pairwise

from plant.model.geometry import distance_m
from plant.model.types import Circle, Point


class Mover:
    """One moving disc; its position is a closed function of time."""

    def __init__(self, circle: Circle) -> None:
        self.radius_m = circle.radius_m
        self.speed_m_s = circle.speed_m_s
        self._legs = list(pairwise(circle.path_m))
        self._lengths_m = [distance_m(a, b) for a, b in self._legs]
        self._ends_m = list(accumulate(self._lengths_m))

    def position_m(self, time_s: float) -> Point:
        """Return the position at a time."""
        whole_m = self._ends_m[-1]
        gone_m = (time_s * self.speed_m_s) % (2.0 * whole_m)
        along_m = gone_m if gone_m <= whole_m else 2.0 * whole_m - gone_m
        leg = next((i for i, end_m in enumerate(self._ends_m) if along_m <= end_m), -1)
        (ax, ay), (bx, by) = self._legs[leg]
        if self._lengths_m[leg] == 0.0:
            return bx, by
        share = 1.0 - (self._ends_m[leg] - along_m) / self._lengths_m[leg]
        return ax + share * (bx - ax), ay + share * (by - ay)
