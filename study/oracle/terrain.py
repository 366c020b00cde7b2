"""Cells of 4 cm with the cost of driving through them, from the evidence about cells of 2 cm."""

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from study.oracle.cones import CELL_MM, REACH_MM, Ints, Shorts
from study.oracle.evidence import MAYBE, SURE, Evidence

PART: Final = 2
"""Cells of evidence per cell of terrain along a side."""

SIDE_MM: Final = PART * CELL_MM
BLOCKED_MM: Final = 115
"""The robot's centre cannot be so near to an obstacle; its radius is 120 mm, the rest is rounding.

A passage of 0.30 m, the narrowest of the corpus, leaves a row of cells free wherever it lies.
"""
CLOSE_MM: Final = 190
MARGIN: Final = (REACH_MM + CLOSE_MM) // SIDE_MM + 2
"""Cells around the robot that an update may change."""

FREE: Final = 4
CLOSE: Final = 4
DOUBTFUL: Final = 12
"""Cost of a free cell; additional costs near an obstacle, and near one that may be there."""


class Terrain:
    """Cost of each cell, 0 where the robot cannot be, in rows of `width`.

    `sure`, `close` and `maybe` count the obstacles near each cell: those that block it, those that
    are close, and the doubtful ones that may block it. `costs` is another view of `cost`.
    """

    def __init__(self, evidence: Evidence) -> None:
        self.width, self.height = evidence.width // PART, evidence.height // PART
        count = self.width * self.height
        self.sure: Shorts = np.zeros(count, dtype=np.int16)
        self.close: Shorts = np.zeros(count, dtype=np.int16)
        self.maybe: Shorts = np.zeros(count, dtype=np.int16)
        self.cost = bytearray(bytes([FREE]) * count)
        self.costs: NDArray[np.uint8] = np.frombuffer(self.cost, dtype=np.uint8)
        self.seal()

    def seal(self) -> None:
        """Block the rim, so that no search leaves the grid."""
        rows = self.costs.reshape(self.height, self.width)
        rows[0] = rows[-1] = 0
        rows[:, 0] = rows[:, -1] = 0


@lru_cache(maxsize=16)
def disc(radius_mm: int, part_x: int, part_y: int, width: int) -> Ints:
    """Return the offsets of the cells whose centre is near a part of a cell."""
    reach = radius_mm // SIDE_MM + 1
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    half_mm = (SIDE_MM - CELL_MM) // 2
    x_mm = x * SIDE_MM + half_mm - part_x * CELL_MM
    y_mm = y * SIDE_MM + half_mm - part_y * CELL_MM
    near = x_mm * x_mm + y_mm * y_mm <= radius_mm * radius_mm
    found: Ints = (y * width + x)[near]
    return found


def change(terrain: Terrain, evidence: Evidence, cells: Ints, before: Shorts) -> bool:
    """Count the obstacles again after changes of some cells; return whether any count changed."""
    after = evidence.score[cells]
    changed = False
    for least, radius_mm, counts in (
        (SURE, BLOCKED_MM, terrain.sure),
        (SURE, CLOSE_MM, terrain.close),
        (MAYBE, BLOCKED_MM, terrain.maybe),
    ):
        for sign, chosen in (
            (1, (after >= least) & (before < least)),
            (-1, (after < least) & (before >= least)),
        ):
            if chosen.any():
                add(counts, terrain.width, evidence.width, cells[chosen], radius_mm, sign)
                changed = True
    return changed


def add(
    counts: Shorts, width: int, fine_width: int, cells: Ints, radius_mm: int, sign: int
) -> None:
    """Add obstacles in some cells of evidence, or take them away, in a disc around each."""
    y, x = np.divmod(cells, fine_width)
    at = y // PART * width + x // PART
    part = y % PART * PART + x % PART
    near = [
        (at[part == each][:, None] + disc(radius_mm, each % PART, each // PART, width)).ravel()
        for each in range(PART * PART)
    ]
    np.add.at(counts, np.concatenate(near), sign)


def price(terrain: Terrain, column: int, row: int, margin: int = MARGIN) -> None:
    """Compute the costs around a cell again."""
    low_x, high_x = max(column - margin, 1), min(column + margin + 1, terrain.width - 1)
    low_y, high_y = max(row - margin, 1), min(row + margin + 1, terrain.height - 1)
    window = (slice(low_y, high_y), slice(low_x, high_x))
    shape = (terrain.height, terrain.width)
    sure, close, maybe = (
        each.reshape(shape)[window] for each in (terrain.sure, terrain.close, terrain.maybe)
    )
    cost = np.where(close > 0, FREE + CLOSE, FREE) + np.where(maybe > sure, DOUBTFUL, 0)
    cost[sure > 0] = 0
    terrain.costs.reshape(shape)[window] = cost


def price_all(terrain: Terrain) -> None:
    """Compute all costs again."""
    price(terrain, 0, 0, max(terrain.width, terrain.height))


def terrain_of(evidence: Evidence) -> Terrain:
    """Return the terrain of a map."""
    terrain = Terrain(evidence)
    cells = np.flatnonzero(evidence.score >= MAYBE)
    change(terrain, evidence, cells, np.zeros(len(cells), dtype=np.int16))
    price_all(terrain)
    return terrain
