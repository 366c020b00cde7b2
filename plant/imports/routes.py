"""Shortest path of the robot's disc over a floor of many cells, faster than the exact search.

Two steps: A* over a grid of places, with moves in sixteen directions, finds a path that is at most
2.8 % too long. Then the exact search of `plant.placement.shortest_path` runs over corners near that
path only. The length is exact unless another route is shorter by less than that.
"""

from heapq import heappop, heappush
from math import ceil, inf
from typing import Final

import numpy as np

from plant.imports.cells import Cells, Mask, standing
from plant.model.geometry import distance_m, length_m
from plant.model.types import Point, World
from plant.placement.near_path import near_path
from runtime.elementary import hypot

PITCH_M: Final = 0.15
"""Largest distance of places; cells are divided into an odd number, so that one is central."""

ROUND_A_PLACE: Final = 3


class Places:
    """Possible positions of the robot's centre, on a grid finer than the cells."""

    def __init__(self, cells: Cells, radius_m: float) -> None:
        parts = ceil(cells.cell_m / PITCH_M)
        self._cells = cells.finer(parts + 1 - parts % 2)
        self.free: Mask = standing(self._cells, radius_m)
        self._flat: list[bool] = np.pad(self.free, 2).ravel().tolist()
        self._width = self._cells.columns + 4
        self._moves = _moves(self._width)

    def nearest(self, point: Point) -> int | None:
        """Return the nearest free place around a point."""
        pitch_m = self._cells.cell_m
        column, row = int(point[0] / pitch_m), int(point[1] / pitch_m)
        around = range(-ROUND_A_PLACE, ROUND_A_PLACE + 1)
        near = [(self._number(row + up, column + right)) for up in around for right in around]
        free = [one for one in near if one is not None]
        return min(free, key=lambda one: distance_m(point, self.point(one)), default=None)

    def _number(self, row: int, column: int) -> int | None:
        if not (0 <= row < self._cells.rows and 0 <= column < self._cells.columns):
            return None
        number = (row + 2) * self._width + column + 2
        return number if self._flat[number] else None

    def cell(self, number: int) -> tuple[int, int]:
        """Return row and column of a place in `free`."""
        row, column = divmod(number, self._width)
        return row - 2, column - 2

    def point(self, number: int) -> Point:
        """Return the position of a place."""
        return self._cells.centre(*self.cell(number))

    def way(self, start: Point, goal: Point) -> list[Point] | None:
        """Return the places from one to the other, both included; None if there is no path."""
        first, last = self.nearest(start), self.nearest(goal)
        if first is None or last is None:
            return None
        came_from = self._search(first, last)
        if last not in came_from:
            return None
        numbers = [last]
        while numbers[-1] != first:
            numbers.append(came_from[numbers[-1]])
        return [start, *(self.point(number) for number in reversed(numbers)), goal]

    def _search(self, first: int, last: int) -> dict[int, int]:
        """Return each place's predecessor, as far as A* came."""
        free, width, moves = self._flat, self._width, self._moves
        last_row, last_column = divmod(last, width)
        cost = {first: 0.0}
        came_from: dict[int, int] = {first: first}
        done: set[int] = set()
        open_places = [(0.0, first)]
        while open_places:
            _, here = heappop(open_places)
            if here == last:
                break
            if here in done:
                continue
            done.add(here)
            here_cost = cost[here]
            for step, length, between in moves:
                there = here + step
                if not free[there] or not all(free[here + one] for one in between):
                    continue
                there_cost = here_cost + length
                if there_cost < cost.get(there, inf):
                    cost[there] = there_cost
                    came_from[there] = here
                    row, column = divmod(there, width)
                    ahead = hypot(row - last_row, column - last_column)
                    heappush(open_places, (there_cost + ahead, there))
        return came_from


def _moves(width: int) -> list[tuple[int, float, tuple[int, ...]]]:
    """Return sixteen moves: step, length, and the places beside it that must be free, too."""
    moves: list[tuple[int, float, tuple[int, ...]]] = []
    for right, up in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        moves.append((up * width + right, 1.0, ()))
    for right in (-1, 1):
        for up in (-width, width):
            moves.append((up + right, hypot(1.0, 1.0), (up, right)))
            moves.append((up + 2 * right, hypot(1.0, 2.0), (right, up + right)))
            moves.append((2 * up + right, hypot(1.0, 2.0), (up, up + right)))
    return moves


def route_m(world: World, places: Places, radius_m: float) -> float | None:
    """Return the length of the shortest path of a world of cells; None if there is none."""
    way = places.way((world.start.x_m, world.start.y_m), (world.goal.x_m, world.goal.y_m))
    if way is None:
        return None
    return length_m(near_path(world, way, radius_m))
