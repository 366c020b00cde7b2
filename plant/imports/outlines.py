"""Convert blocked cells to few solid polygons, each the outline of a connected region.

A polygon of a world is simple and has no hole. A region is therefore cut in two if it surrounds
something, if it touches itself at a corner, or if its outline would have too many points.
"""

from itertools import pairwise
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from plant.imports.cells import Cells, Mask, labelled
from plant.model.types import Polygon

Corner: TypeAlias = tuple[int, int]
"""(column, row) of a corner between cells."""

MAX_POINTS: Final = 80
"""Limit of points: the check of a polygon compares each edge with every other."""


class Region(NamedTuple):
    """A part of the floor, with the position of its lower left cell."""

    mask: Mask
    row: int
    column: int


def outlines(cells: Cells) -> list[Polygon]:
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


def _polygon(loop: list[Corner], region: Region, cell_m: float) -> Polygon:
    return Polygon(
        tuple(
            (round((x + region.column) * cell_m, 6), round((y + region.row) * cell_m, 6))
            for x, y in loop
        )
    )
