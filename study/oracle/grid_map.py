"""The map of `oracle_grid`: evidence and terrain, extended as the robot gets near its rim."""

from typing import Final

import numpy as np

from robot.core.perception.sonar_ring import Ring
from runtime.elementary import hypot
from study.oracle.cones import CELL_MM, REACH_MM
from study.oracle.evidence import SURE, Evidence, update
from study.oracle.route import STRAIGHT
from study.oracle.terrain import PART, SIDE_MM, Terrain, change, price, terrain_of

ROOM_MM: Final = 4000
"""Width of unknown floor around start, goal and robot that a route may use."""
ROOM_LEFT_MM: Final = REACH_MM + 500
OWN_MM: Final = 160
"""Around the robot, blocked cells are passable: it is there. Less than a wall and two radii."""

MARKED: Final = 40
"""Score of a place where the robot was held up."""
CONFIRMED: Final = 10
DOUBTED: Final = SURE - 1


class GridMap:
    """Evidence about cells of 2 cm and the terrain of cells of 4 cm; places are in mm."""

    def __init__(self, low_mm: tuple[int, int], high_mm: tuple[int, int]) -> None:
        """Create an empty map of a rectangle with ROOM_MM around it, rounded to whole cells."""
        left, low = ((each - ROOM_MM) // SIDE_MM * PART for each in low_mm)
        right, high = ((each + ROOM_MM) // SIDE_MM * PART for each in high_mm)
        self.evidence = Evidence(left, low, right - left, high - low)
        self.terrain = Terrain(self.evidence)

    def cell_of(self, x_mm: int, y_mm: int) -> int:
        """Return the index of the cell of terrain at a place."""
        column = x_mm // SIDE_MM - self.evidence.left // PART
        row = y_mm // SIDE_MM - self.evidence.low // PART
        return row * self.terrain.width + column

    def has_room(self, x_mm: int, y_mm: int) -> bool:
        """Return whether the robot's sonars reach only cells of the map."""
        left_mm, low_mm = self.evidence.left * CELL_MM, self.evidence.low * CELL_MM
        right_mm = left_mm + self.evidence.width * CELL_MM
        high_mm = low_mm + self.evidence.height * CELL_MM
        return (
            left_mm + ROOM_LEFT_MM < x_mm < right_mm - ROOM_LEFT_MM
            and low_mm + ROOM_LEFT_MM < y_mm < high_mm - ROOM_LEFT_MM
        )

    def extended(self, x_mm: int, y_mm: int) -> "GridMap":
        """Return this map with room around a place."""
        old = self.evidence
        left_mm, low_mm = old.left * CELL_MM + ROOM_MM, old.low * CELL_MM + ROOM_MM
        right_mm = left_mm + old.width * CELL_MM - 2 * ROOM_MM
        high_mm = low_mm + old.height * CELL_MM - 2 * ROOM_MM
        made = GridMap(
            (min(x_mm, left_mm), min(y_mm, low_mm)), (max(x_mm, right_mm), max(y_mm, high_mm))
        )
        new = made.evidence
        row, column = old.low - new.low, old.left - new.left
        scores = new.score.reshape(new.height, new.width)
        scores[row : row + old.height, column : column + old.width] = old.score.reshape(
            old.height, old.width
        )
        made.terrain = terrain_of(new)
        return made

    def look(self, x_mm: int, y_mm: int, heading: int, ring: Ring, radius_mm: int) -> None:
        """Take the echoes of a ring at a pose, heading in brads."""
        cells, before = update(self.evidence, x_mm, y_mm, heading, ring, radius_mm)
        if change(self.terrain, self.evidence, cells, before):
            self._price(x_mm, y_mm)

    def mark(self, x_mm: int, y_mm: int) -> None:
        """Mark a place as occupied for long: the robot cannot drive there."""
        at, width = self.evidence.index(x_mm, y_mm), self.evidence.width
        cells = np.array([at, at - 1, at + 1, at - width, at + width])
        before = self.evidence.score[cells]
        self.evidence.score[cells] = MARKED
        change(self.terrain, self.evidence, cells, before)
        self._price(x_mm, y_mm)

    def doubt(self) -> bool:
        """Doubt all obstacles that were not confirmed; return whether there were any."""
        score = self.evidence.score
        cells = np.flatnonzero((score >= SURE) & (score < CONFIRMED))
        score[cells] = DOUBTED
        self.terrain = terrain_of(self.evidence)
        return len(cells) > 0

    def line_cost(self, x_mm: int, y_mm: int, to_x_mm: int, to_y_mm: int) -> int:
        """Return the cost of a straight line, 0 if it is blocked farther than OWN_MM from here."""
        dx_mm, dy_mm = to_x_mm - x_mm, to_y_mm - y_mm
        length_mm = int(hypot(dx_mm, dy_mm))
        steps = length_mm // CELL_MM + 1
        part = np.arange(1, steps + 1)
        columns = (x_mm + dx_mm * part // steps) // SIDE_MM - self.evidence.left // PART
        rows = (y_mm + dy_mm * part // steps) // SIDE_MM - self.evidence.low // PART
        cost = self.terrain.costs[rows * self.terrain.width + columns]
        if (cost[OWN_MM // CELL_MM :] == 0).any():
            return 0
        total = int(cost.sum(dtype=np.int64))
        return total * STRAIGHT * length_mm // (steps * SIDE_MM) + 1

    def _price(self, x_mm: int, y_mm: int) -> None:
        at = self.cell_of(x_mm, y_mm)
        price(self.terrain, at % self.terrain.width, at // self.terrain.width)
