"""Routes through the map of `oracle_grid`, and where on its route the robot is."""

from typing import Final, NamedTuple

import numpy as np

from study.oracle.cones import Ints
from study.oracle.grid_map import OWN_MM, GridMap
from study.oracle.route import DIAGONAL, STRAIGHT, search
from study.oracle.terrain import FREE, PART, SIDE_MM, Terrain

OWN_COST: Final = 40
BESIDE_MM: Final = 350
"""Farther from the route the robot searches another one."""
DEARER: Final = 130
DEARER_BY: Final = 60 * STRAIGHT
"""A route is searched again if its cost exceeds the planned one by these: percent, and cost."""
AHEAD: Final = 24
"""Cells of the route among which the nearest one is looked for."""
SIGHTS: Final = (120, 80, 60, 45, 34, 25, 18, 13, 9, 6, 4)
"""Cells ahead on the route that the robot tries to head for in a straight line."""
EQUAL: Final = 105
"""Percent of the cost of the route up to which a straight line replaces it."""


class Route(NamedTuple):
    """Cells, their places, and the cost from the start up to each when it was planned."""

    cells: Ints
    x_mm: Ints
    y_mm: Ints
    cost: Ints


def find_route(grid: GridMap, x_mm: int, y_mm: int, goal_x_mm: int, goal_y_mm: int) -> Route | None:
    """Search the cheapest route; None if there is none."""
    terrain, evidence = grid.terrain, grid.evidence
    start, end = grid.cell_of(x_mm, y_mm), grid.cell_of(goal_x_mm, goal_y_mm)
    opened = open_cells(terrain, start, OWN_MM // SIDE_MM) + open_cells(terrain, end, 1)
    found = search(terrain.cost, terrain.width, start, end, FREE)
    for cell in opened:
        terrain.cost[cell] = 0
    if not found:
        return None
    cells = np.array(found)
    columns, rows = cells % terrain.width, cells // terrain.width
    turned = (columns[1:] != columns[:-1]) & (rows[1:] != rows[:-1])
    cost = terrain.costs[cells[1:]].astype(np.int64)
    cost[cost == 0] = OWN_COST
    return Route(
        cells,
        (columns + evidence.left // PART) * SIDE_MM + SIDE_MM // 2,
        (rows + evidence.low // PART) * SIDE_MM + SIDE_MM // 2,
        np.concatenate([[0], np.cumsum(cost * np.where(turned, DIAGONAL, STRAIGHT))]),
    )


def open_cells(terrain: Terrain, centre: int, reach: int) -> list[int]:
    """Make blocked cells around a place passable at OWN_COST; return which."""
    opened = []
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            cell = centre + dy * terrain.width + dx
            if dx * dx + dy * dy <= reach * reach and terrain.cost[cell] == 0:
                terrain.cost[cell] = OWN_COST
                opened.append(cell)
    return opened


def place_on(route: Route, at: int, x_mm: int, y_mm: int) -> int | None:
    """Return the nearest place of the route from place `at` on; None if it is too far away."""
    near = slice(at, at + AHEAD)
    dx_mm, dy_mm = route.x_mm[near] - x_mm, route.y_mm[near] - y_mm
    squares = dx_mm * dx_mm + dy_mm * dy_mm
    nearest = int(squares.argmin())
    return None if squares[nearest] > BESIDE_MM * BESIDE_MM else at + nearest


def is_still_good(grid: GridMap, route: Route, at: int) -> bool:
    """Return whether the rest of a route has not become blocked or much dearer."""
    cost = grid.terrain.costs[route.cells[at:]]
    if (cost[OWN_MM // SIDE_MM :] == 0).any():
        return False
    planned = int(route.cost[-1] - route.cost[at])
    now = int(cost.sum(dtype=np.int64)) * STRAIGHT
    return now * 100 <= planned * DEARER + DEARER_BY * 100


def target_on(grid: GridMap, route: Route, at: int, x_mm: int, y_mm: int) -> tuple[int, int]:
    """Return the farthest place of the route to which the straight line costs no more."""
    last = len(route.cells) - 1
    to = min(at + SIGHTS[-1] - 1, last)
    for place in dict.fromkeys(min(at + sight, last) for sight in SIGHTS):
        line = grid.line_cost(x_mm, y_mm, int(route.x_mm[place]), int(route.y_mm[place]))
        along = int(route.cost[place] - route.cost[at])
        if 0 < line * 100 <= EQUAL * along + FREE * STRAIGHT * 100:
            to = place
            break
    return int(route.x_mm[to]), int(route.y_mm[to])
