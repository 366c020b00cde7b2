"""Select start and goal on a floor of cells."""

from typing import Final

import numpy as np

from plant.imports.cells import Cells, Labels, labelled, standing
from plant.imports.routes import Places
from plant.model.draws import Draws
from plant.model.geometry import distance_m
from plant.model.types import Point

STANDING_M: Final = 0.17
"""Smallest distance of a place from any obstacle."""

PAIRS: Final = 6
MAX_DRAWS: Final = 200
MIN_APART_M: Final = 1.0


def far_apart(cells: Cells, random: Draws, radius_m: float) -> tuple[Point, Point] | None:
    """Return the most distant of a few random pairs of connected cells."""
    rows, columns = np.nonzero(standing(cells, STANDING_M))
    if not len(rows):
        return None
    regions = _Regions(cells, radius_m)
    found: list[tuple[Point, Point]] = []
    for _ in range(MAX_DRAWS):
        one, other = (random.randrange(len(rows)) for _ in range(2))
        start = cells.centre(int(rows[one]), int(columns[one]))
        goal = cells.centre(int(rows[other]), int(columns[other]))
        if distance_m(start, goal) >= MIN_APART_M and regions.joined(start, goal):
            found.append((start, goal))
        if len(found) == PAIRS:
            break
    return max(found, key=lambda pair: distance_m(*pair), default=None)


class _Regions:
    """Connected regions of places."""

    def __init__(self, cells: Cells, radius_m: float) -> None:
        self._places = Places(cells, radius_m)
        self._labels: Labels = labelled(self._places.free)

    def joined(self, a: Point, b: Point) -> bool:
        """Return whether a robot can drive between two points."""
        at_a, at_b = (self._places.nearest(point) for point in (a, b))
        if at_a is None or at_b is None:
            return False
        label = self._label(at_a)
        return label == self._label(at_b)

    def _label(self, number: int) -> int:
        return int(self._labels[self._places.cell(number)])
