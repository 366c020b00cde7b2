"""A floor of square cells, each blocked or free, and the places where a robot fits."""

from math import ceil
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant.model.draws import Draws
from plant.model.types import Point
from runtime.elementary import cos, hypot, sin

Mask: TypeAlias = NDArray[np.bool_]
Labels: TypeAlias = NDArray[np.int64]

TOUCHING_M: Final = 1e-9


class Cells(NamedTuple):
    """`blocked[row, column]`, row 0 at the bottom; `corner` is the lower left one in the map."""

    blocked: Mask
    cell_m: float
    corner: Point = (0.0, 0.0)
    yaw_rad: float = 0.0

    @property
    def rows(self) -> int:
        """The number of rows."""
        return int(self.blocked.shape[0])

    @property
    def columns(self) -> int:
        """The number of columns."""
        return int(self.blocked.shape[1])

    @property
    def size_m(self) -> Point:
        """The size of the floor."""
        return round(self.columns * self.cell_m, 6), round(self.rows * self.cell_m, 6)

    def centre(self, row: int, column: int) -> Point:
        """Return the centre of a cell."""
        return round((column + 0.5) * self.cell_m, 6), round((row + 0.5) * self.cell_m, 6)

    def on_floor(self, place: Point) -> Point:
        """Convert a place from the map's frame to our floor, whose lower left corner is (0, 0)."""
        away_x, away_y = place[0] - self.corner[0], place[1] - self.corner[1]
        c, s = cos(self.yaw_rad), sin(self.yaw_rad)
        return round(c * away_x + s * away_y, 6), round(c * away_y - s * away_x, 6)

    def part(self, row: int, column: int, rows: int, columns: int) -> "Cells":
        """Return a rectangle, given by its lower left cell and size."""
        right_m, up_m = column * self.cell_m, row * self.cell_m
        c, s = cos(self.yaw_rad), sin(self.yaw_rad)
        corner = (
            self.corner[0] + c * right_m - s * up_m,
            self.corner[1] + s * right_m + c * up_m,
        )
        blocked = self.blocked[row : row + rows, column : column + columns]
        return self._replace(blocked=blocked, corner=corner)

    def trimmed(self) -> "Cells":
        """Return the cells without the blocked rows and columns at the rim.

        Outer walls replace them.
        """
        rows = np.flatnonzero(~self.blocked.all(axis=1))
        columns = np.flatnonzero(~self.blocked.all(axis=0))
        if not len(rows):
            return self
        (top, right), (low, left) = (rows[-1], columns[-1]), (rows[0], columns[0])
        return self.part(int(low), int(left), int(top - low) + 1, int(right - left) + 1)

    def window(self, random: Draws, side: int) -> "Cells":
        """Return a random square part with that many cells a side; all if the floor is smaller."""
        rows, columns = min(side, self.rows), min(side, self.columns)
        row, column = random.randint(0, self.rows - rows), random.randint(0, self.columns - columns)
        return self.part(row, column, rows, columns)

    def finer(self, parts: int) -> "Cells":
        """Return the same floor with each cell divided into parts * parts."""
        blocked = self.blocked.repeat(parts, axis=0).repeat(parts, axis=1)
        return self._replace(blocked=blocked, cell_m=self.cell_m / parts)


def standing(cells: Cells, room_m: float) -> Mask:
    """Return the cells whose centre is at least `room_m` from blocked cells and the rim."""
    reach = ceil(room_m / cells.cell_m + 0.5)
    padded = np.pad(cells.blocked, reach, constant_values=True)
    free = np.ones_like(cells.blocked)
    for up in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            gap_m = cells.cell_m * hypot(max(0.0, abs(up) - 0.5), max(0.0, abs(right) - 0.5))
            if gap_m < room_m - TOUCHING_M or (up == 0 and right == 0):
                rows = slice(reach + up, reach + up + cells.rows)
                columns = slice(reach + right, reach + right + cells.columns)
                free &= ~padded[rows, columns]
    return free


def labelled(mask: Mask) -> Labels:
    """Label the connected regions of a mask from 1; 0 outside. Corners do not connect."""
    labels = np.zeros(mask.shape, dtype=np.int64)
    joined = [0]
    runs_below: list[tuple[int, int, int]] = []
    for row in range(mask.shape[0]):
        steps = np.diff(mask[row].astype(np.int8), prepend=0, append=0)
        begins, ends = np.flatnonzero(steps == 1).tolist(), np.flatnonzero(steps == -1).tolist()
        runs: list[tuple[int, int, int]] = []
        for begin, end in zip(begins, ends, strict=True):
            touching = [run[2] for run in runs_below if run[0] < end and begin < run[1]]
            if not touching:
                touching = [len(joined)]
                joined.append(len(joined))
            roots = {_root(joined, one) for one in touching}
            label = min(roots)
            for root in roots:
                joined[root] = label
            runs.append((begin, end, label))
            labels[row, begin:end] = label
        runs_below = runs
    roots_of = np.array([_root(joined, label) for label in range(len(joined))])
    numbered: Labels = np.unique(np.append(roots_of, 0), return_inverse=True)[1][:-1]
    return numbered[labels]


def _root(joined: list[int], label: int) -> int:
    while joined[label] != label:
        label = joined[label]
    return label
