"""Place trunks at random on a floor, with a passage between any two."""

from math import dist
from typing import Final

import numpy as np

from protocol.world import Circle, Point

MIN_THICKNESS_M: Final = 0.05
MAX_THICKNESS_M: Final = 0.15
PASSAGE_M: Final = 0.40
CLEARING_M: Final = 0.50
MAX_THROWS: Final = 100_000


def grow(count: int, size_m: Point, clearings: tuple[Point, ...], seed: int) -> tuple[Circle, ...]:
    """Return `count` trunks in millimetre steps, clear of `clearings`; ValueError if too many."""
    random = np.random.default_rng(seed)
    trunks: list[Circle] = []
    for _ in range(MAX_THROWS):
        radius_m = round(float(random.uniform(MIN_THICKNESS_M, MAX_THICKNESS_M)), 3)
        margin_m = radius_m + PASSAGE_M
        x_m, y_m = (round(float(random.uniform(margin_m, side - margin_m)), 3) for side in size_m)
        trunk = Circle(x_m=x_m, y_m=y_m, radius_m=radius_m)
        if _fits(trunk, trunks, clearings):
            trunks.append(trunk)
        if len(trunks) == count:
            return tuple(trunks)
    raise ValueError(f"{count} trunks do not fit on {size_m[0]:g} x {size_m[1]:g} m")


def _fits(trunk: Circle, trunks: list[Circle], clearings: tuple[Point, ...]) -> bool:
    here = (trunk.x_m, trunk.y_m)
    return all(dist(here, point) >= trunk.radius_m + CLEARING_M for point in clearings) and all(
        dist(here, (other.x_m, other.y_m)) >= trunk.radius_m + other.radius_m + PASSAGE_M
        for other in trunks
    )
