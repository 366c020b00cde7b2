"""A floor of square cells, each blocked or free, and the outlines of the blocked ones.

A polygon of a world is simple and has no hole. A region is therefore cut in two if it surrounds
something, if it touches itself at a corner, or if its outline would have too many points.
"""

from itertools import pairwise
from math import ceil
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant.model.draws import Draws
from plant.model.geometry import TOUCHING_M
from protocol.world import Point, WorldPolygon
from runtime.elementary import cos, hypot, sin

Mask: TypeAlias = NDArray[np.bool_]
Labels: TypeAlias = NDArray[np.int64]

MAX_COORDINATE_M: Final = 1e6
"""Limit for the coordinates of a map."""


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


Corner: TypeAlias = tuple[int, int]
"""(column, row) of a corner between cells."""

MAX_POINTS: Final = 80
"""Limit of points: the check of a polygon compares each edge with every other."""


class Region(NamedTuple):
    """A part of the floor, with the position of its lower left cell."""

    mask: Mask
    row: int
    column: int


def outlines(cells: Cells) -> list[WorldPolygon]:
    """Return the polygons, in a fixed order."""
    todo = _regions(Region(cells.blocked, 0, 0))[::-1]
    found = []
    while todo:
        region = todo.pop()
        loops = _loops(region.mask)
        cut = _cut(region.mask, loops)
        if cut is None:
            found.append(_polygon(loops[0], region, cells.cell_m))
        else:
            todo += [part for half in _halves(region, *cut) for part in _regions(half)][::-1]
    return found


def _regions(whole: Region) -> list[Region]:
    """Return the connected regions, each in its own bounding box."""
    labels = labelled(whole.mask)
    rows, columns = np.nonzero(labels)
    regions = []
    numbers = labels[rows, columns]
    order = np.argsort(numbers, kind="stable")
    ends = np.searchsorted(numbers[order], np.arange(1, labels.max(initial=0) + 2))
    for label, (begin, end) in enumerate(pairwise(ends.tolist()), 1):
        its_rows, its_columns = rows[order[begin:end]], columns[order[begin:end]]
        low, left = int(its_rows.min()), int(its_columns.min())
        box = labels[low : int(its_rows.max()) + 1, left : int(its_columns.max()) + 1]
        regions.append(Region(box == label, whole.row + low, whole.column + left))
    return regions


def _loops(mask: Mask) -> list[list[Corner]]:
    """Return the corners of the outlines, solid on the left; the longest, outer one first.

    If two cells meet only at a corner, the outline stays with its own cell.
    """
    after = _sides(mask)
    loops = []
    while after:
        start = next(iter(after))
        here, loop, came = start, [], (0, 0)
        while here in after:
            ways = after[here]
            step = ways.pop() if len(ways) == 1 or came == (0, 0) else _left(came, ways)
            if not ways:
                del after[here]
            if step != came:
                loop.append(here)
            came = step
            here = (here[0] + step[0], here[1] + step[1])
        loops.append(_without_straight_start(loop))
    return sorted(loops, key=_area, reverse=True)


def _sides(mask: Mask) -> dict[Corner, list[Corner]]:
    """Return, for each corner, the steps along sides between a blocked and a free cell."""
    padded = np.pad(mask, 1)
    after: dict[Corner, list[Corner]] = {}
    # Around a cell: along its lower side to the right, along its right side upwards ...
    for step, (up, right), (add_x, add_y) in (
        ((1, 0), (-1, 0), (0, 0)),
        ((0, 1), (0, 1), (1, 0)),
        ((-1, 0), (1, 0), (1, 1)),
        ((0, -1), (0, -1), (0, 1)),
    ):
        beside = padded[1 + up : padded.shape[0] - 1 + up, 1 + right : padded.shape[1] - 1 + right]
        for row, column in np.argwhere(mask & ~beside).tolist():
            after.setdefault((column + add_x, row + add_y), []).append(step)
    return after


def _left(came: Corner, ways: list[Corner]) -> Corner:
    """Remove and return the step that turns left."""
    left = (-came[1], came[0])
    ways.remove(left)
    return left


def _without_straight_start(loop: list[Corner]) -> list[Corner]:
    """Return a loop without its first corner if the outline is straight there."""
    (x0, y0), (x1, y1), (x2, y2) = loop[-1], loop[0], loop[1]
    straight = (x1 - x0) * (y2 - y1) == (y1 - y0) * (x2 - x1)
    return loop[1:] if straight else loop


def _area(loop: list[Corner]) -> int:
    """Return twice the area, below zero around a hole."""
    ends = loop[1:] + loop[:1]
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(loop, ends, strict=True))


def _cut(mask: Mask, loops: list[list[Corner]]) -> tuple[int, int] | None:
    """Return axis (0 rows, 1 columns) and position of a cut; None for a single polygon."""
    if len(loops) > 1:
        rows = [row for _, row in loops[1]]
        return 0, (min(rows) + max(rows) + 1) // 2
    loop = loops[0]
    twice = [corner for corner in set(loop) if loop.count(corner) > 1]
    if twice:
        return 0, min(twice)[1]
    if len(loop) > MAX_POINTS:
        axis = int(mask.shape[1] > mask.shape[0])
        return axis, mask.shape[axis] // 2
    return None


def _halves(region: Region, axis: int, at: int) -> tuple[Region, Region]:
    mask, row, column = region
    if axis == 0:
        return Region(mask[:at], row, column), Region(mask[at:], row + at, column)
    return Region(mask[:, :at], row, column), Region(mask[:, at:], row, column + at)


def _polygon(loop: list[Corner], region: Region, cell_m: float) -> WorldPolygon:
    return WorldPolygon(
        tuple(
            (round((x + region.column) * cell_m, 6), round((y + region.row) * cell_m, 6))
            for x, y in loop
        )
    )
