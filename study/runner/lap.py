"""Length of the boundary that a robot must follow to prove that its goal is unreachable."""

from collections.abc import Iterable
from functools import lru_cache
from itertools import combinations
from math import ceil, sqrt
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant.model.configuration import body_of
from plant.model.types import World
from plant.shortest_path import Array, blocked_by

FINEST_M: Final = 0.02
MAX_NODES: Final = 400_000
"""On a larger floor the grid is coarser."""

RIM_M: Final = 1.0
"""Free width around a floor without outer walls."""

BAND_CELLS: Final = 2.0
"""The distance to the boundary is exact up to so many cells, which its length needs."""

OUTSIDE_CELLS: Final = 0.1
CORNERS: Final = ((0, 0), (0, 1), (1, 1), (1, 0))
NEIGHBOURS: Final = ((0, 1), (1, 0), (0, -1), (-1, 0))
DIAGONALS: Final = ((1, 1), (1, -1), (-1, 1), (-1, -1))

Mask: TypeAlias = NDArray[np.bool_]
Node: TypeAlias = tuple[int, int]


class Grid:
    """Nodes on a floor; `room_m` is their distance from the places that the robot cannot take.

    It is negative where the robot's centre cannot be, and cut off far from the boundary. A passage
    narrower than a cell may be closed in it.
    """

    def __init__(self, world: World) -> None:
        width_m, height_m = world.size_m
        rim_m = 0.0 if world.walls else RIM_M
        area_m2 = (width_m + 2 * rim_m) * (height_m + 2 * rim_m)
        self.cell_m = max(FINEST_M, sqrt(area_m2 / MAX_NODES))
        self._low_m = -rim_m - self.cell_m
        nodes = [ceil((size_m + rim_m - self._low_m) / self.cell_m) + 2 for size_m in world.size_m]
        self.xs_m, self.ys_m = (self._low_m + self.cell_m * np.arange(count) for count in nodes)
        self.room_m = np.full((len(self.xs_m), len(self.ys_m)), BAND_CELLS * self.cell_m)
        self._grow(world)

    def node(self, x_m: float, y_m: float) -> Node:
        """Return the node nearest to a place."""
        column, row = (round((value_m - self._low_m) / self.cell_m) for value_m in (x_m, y_m))
        return column, row

    def _grow(self, world: World) -> None:
        radius_m = body_of(world).radius_m
        blocked = blocked_by(world, radius_m)
        if world.walls:
            for axis, places_m in enumerate((self.xs_m, self.ys_m)):
                inside_m = np.minimum(places_m, world.size_m[axis] - places_m) - radius_m
                shape = (-1, 1) if axis == 0 else (1, -1)
                np.minimum(self.room_m, inside_m.reshape(shape), out=self.room_m)
        for centre, grown_m in zip(blocked.centres, blocked.radii.tolist(), strict=True):
            self._remove(centre, centre, grown_m)
        sizes_m = dict(
            zip(map(tuple, blocked.centres.tolist()), blocked.radii.tolist(), strict=True)
        )
        for tail, head in zip(blocked.tails, blocked.heads, strict=True):
            self._remove(tail, head, sizes_m[tuple(tail.tolist())])

    def _remove(self, a: Array, b: Array, grown_m: float) -> None:
        """Remove the places nearer than `grown_m` to a segment; a may equal b."""
        reach_m = grown_m + BAND_CELLS * self.cell_m
        low, high = np.minimum(a, b) - reach_m, np.maximum(a, b) + reach_m
        columns = slice(*np.searchsorted(self.xs_m, (low[0], high[0])).tolist())
        rows = slice(*np.searchsorted(self.ys_m, (low[1], high[1])).tolist())
        x_m, y_m = self.xs_m[columns, None] - a[0], self.ys_m[None, rows] - a[1]
        along = b - a
        length2 = float(along @ along)
        share = (
            np.clip((x_m * along[0] + y_m * along[1]) / length2, 0.0, 1.0) if length2 > 0.0 else 0.0
        )
        away_m = np.hypot(x_m - share * along[0], y_m - share * along[1]) - grown_m
        part = self.room_m[columns, rows]
        np.minimum(part, away_m, out=part)


@lru_cache(maxsize=512)
def lap_m(world: World) -> float | None:
    """Return the length of the closed boundary that separates the start from the goal, in metres.

    It is that of the free space of the robot's centre: the line that the centre follows while the
    robot touches the wall. None if the goal can be reached, or the robot does not fit at the start.
    """
    grid = Grid(world)
    start, goal = (grid.node(one.x_m, one.y_m) for one in (world.start, world.goal))
    free = grid.room_m > 0.0
    if not free[start]:
        return None
    mine = connected(free, start, NEIGHBOURS)
    if mine[goal]:
        return None
    beyond = connected(~mine, goal, (*NEIGHBOURS, *DIAGONALS))
    outside_m = np.minimum(grid.room_m, -OUTSIDE_CELLS * grid.cell_m)
    return contour_cells(np.where(mine, grid.room_m, outside_m), beyond) * grid.cell_m


def connected(open_nodes: Mask, begin: Node, steps: Iterable[Node]) -> Mask:
    """Return the open nodes that are connected with the first one by these steps."""
    padded = np.pad(open_nodes, 1)
    rows = padded.shape[1]
    unseen = bytearray(padded.astype(np.uint8).tobytes())
    jumps = [column * rows + row for column, row in steps]
    first = (begin[0] + 1) * rows + begin[1] + 1
    found = np.zeros(padded.size, dtype=np.bool_)
    pending = [first] if unseen[first] else []
    places: list[int] = []
    while pending:
        place = pending.pop()
        if not unseen[place]:
            continue
        unseen[place] = 0
        places.append(place)
        pending += [place + jump for jump in jumps if unseen[place + jump]]
    found[places] = True
    return found.reshape(padded.shape)[1:-1, 1:-1]


def contour_cells(values: Array, beyond: Mask) -> float:
    """Return the length, in cells, of the line at zero beside the nodes `beyond`.

    These are marching squares. Where two corners across are positive, the two pieces cut off the
    negative ones.
    """
    corners = [_corner(values, *corner) for corner in CORNERS]
    near = np.any([_corner(beyond, *corner) for corner in CORNERS], axis=0)
    cuts = [_cut(corners, side) for side in range(4)]
    crossed = [np.isfinite(cut[0]) for cut in cuts]
    count = np.sum(crossed, axis=0)
    total = 0.0
    for one, other in combinations(range(4), 2):
        # Side n joins corners n and n + 1, so neighbouring sides share a corner.
        shared = (one + 1) % 4 if other == one + 1 else 0
        is_piece = (count == 2) | ((count == 4) & ((other - one) % 2 == 1) & (corners[shared] < 0))
        chosen = near & crossed[one] & crossed[other] & is_piece
        (x0, y0), (x1, y1) = cuts[one], cuts[other]
        total += float(np.hypot(x1[chosen] - x0[chosen], y1[chosen] - y0[chosen]).sum())
    return total


def _corner(values: NDArray[np.generic], column: int, row: int) -> Any:
    columns, rows = values.shape
    return values[column : columns - 1 + column, row : rows - 1 + row]


def _cut(corners: list[Array], side: int) -> tuple[Array, Array]:
    """Return where the line cuts a side of each square, within it; NaN where it does not."""
    here, there = corners[side], corners[(side + 1) % 4]
    share = np.full(here.shape, np.nan)
    np.divide(here, here - there, out=share, where=(here > 0.0) != (there > 0.0))
    (x0, y0), (x1, y1) = CORNERS[side], CORNERS[(side + 1) % 4]
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0)
