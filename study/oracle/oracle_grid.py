"""The navigator `oracle_grid`: a map of unlimited size, and the shortest route through it.

It has the sensors of the other navigators, and means that the robot does not have. Unknown cells
count as free, and the route is searched again when the map contradicts it. It stands in the robot's
table of navigators only while a trial runs.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from robot.core import states
from robot.core.navigators import pace
from robot.core.navigators.pace import Held
from robot.core.navigators.registry import NAVIGATORS, Navigator
from robot.core.parameters import Params
from robot.core.perception import closing_speed, sonar_ring
from robot.core.perception.echoes import BRADS
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Decision, Goal, Pose, wrap
from runtime.elementary import atan2, cos_sin
from study.oracle.grid_map import (
    DIAGONAL,
    FREE,
    OWN_MM,
    PART,
    SIDE_MM,
    STRAIGHT,
    GridMap,
    Ints,
    Terrain,
    search_route,
)
from study.oracle.names import ORACLE_GRID

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
    found = search_route(terrain.cost, terrain.width, start, end, FREE)
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


EVERY_TICKS: Final = 2
"""Ticks per update of the map: the robot moves at most 3 cm."""

DIRECT: Final = 3 * FREE * STRAIGHT // 2
DIRECT_MORE: Final = 10 * DIRECT
"""A free straight line to the goal costs at most DIRECT per cell, and DIRECT_MORE."""
SMALL_TURN_RAD: Final = 0.17
"""A smaller turn from the goal is no avoiding."""
FLANKS: Final = ((0, 1), (6, 7))
FLANK_M: Final = 0.04
AWAY_RAD: Final = 0.3
"""Nearer than FLANK_M on one side the robot turns at least by AWAY_RAD to the other."""
FREE_MM: Final = 10_000

MAX_STILL: Final = 30
STILL_MM: Final = 20
"""After MAX_STILL updates within STILL_MM a place ahead is marked as occupied."""
BLOCK_MM: Final = 25
MAX_DOUBTS: Final = 6
CONFIRM: Final = 15
"""Updates between two searches without a route, the second of which proves that there is none."""


class OracleMemory:
    """The map, the route, and how far the robot is on it; the target is in mm.

    `hopeless` counts the updates since a search found no route. `doubts` counts how often
    obstacles were doubted then. `still` counts the updates within STILL_MM of a place.
    """

    def __init__(self) -> None:
        self.side: int = states.LEFT
        self.goal_x_m = self.goal_y_m = 0.0
        self.grid: GridMap | None = None
        self.route: Route | None = None
        self.held = Held()
        self.at = self.target_x_mm = self.target_y_mm = 0
        self.sees_goal = self.given_up = False
        self.ticks = self.doubts = self.hopeless = 0
        self.still = self.still_x_mm = self.still_y_mm = 0


def step(memory: OracleMemory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Return where to drive and the speed limit; GIVE_UP if the map proves that no way exists."""
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    grid = memory.grid
    if grid is None or goal.x_m != memory.goal_x_m or goal.y_m != memory.goal_y_m:
        grid = begin(memory, x_mm, y_mm, goal)
    if memory.ticks % EVERY_TICKS == 0 and not memory.given_up:
        if not grid.has_room(x_mm, y_mm):
            grid = memory.grid = grid.extended(x_mm, y_mm)
            memory.route = None
        radius_mm = int(1000.0 * params.radius_m)
        grid.look(x_mm, y_mm, int(BRADS * pose.heading_rad), ring, radius_mm)
        if is_held_up(memory, x_mm, y_mm):
            mark_ahead(memory, grid, x_mm, y_mm, radius_mm + BLOCK_MM)
        choose(memory, grid, x_mm, y_mm)
    memory.ticks += 1
    return decision(memory, pose, ring, goal, params)


def begin(memory: OracleMemory, x_mm: int, y_mm: int, goal: Goal) -> GridMap:
    """Start with an empty map for a new goal."""
    memory.goal_x_m, memory.goal_y_m = goal.x_m, goal.y_m
    goal_x_mm, goal_y_mm = goal_of(memory)
    grid = memory.grid = GridMap(
        (min(x_mm, goal_x_mm), min(y_mm, goal_y_mm)), (max(x_mm, goal_x_mm), max(y_mm, goal_y_mm))
    )
    memory.given_up = False
    memory.route, memory.doubts, memory.hopeless = None, 0, 0
    return grid


def goal_of(memory: OracleMemory) -> tuple[int, int]:
    """Return the goal in mm."""
    return int(1000.0 * memory.goal_x_m), int(1000.0 * memory.goal_y_m)


def is_held_up(memory: OracleMemory, x_mm: int, y_mm: int) -> bool:
    """Return whether the robot has not moved for MAX_STILL updates."""
    dx_mm, dy_mm = x_mm - memory.still_x_mm, y_mm - memory.still_y_mm
    memory.still += 1
    if not -STILL_MM < dx_mm < STILL_MM or not -STILL_MM < dy_mm < STILL_MM:
        memory.still_x_mm, memory.still_y_mm, memory.still = x_mm, y_mm, 0
    if memory.still <= MAX_STILL:
        return False
    memory.still = 0
    return True


def mark_ahead(memory: OracleMemory, grid: GridMap, x_mm: int, y_mm: int, away_mm: int) -> None:
    """Mark a place towards the target as occupied: the guard stops the robot."""
    cosine, sine = cos_sin(atan2(memory.target_y_mm - y_mm, memory.target_x_mm - x_mm))
    grid.mark(x_mm + int(away_mm * cosine), y_mm + int(away_mm * sine))


def choose(memory: OracleMemory, grid: GridMap, x_mm: int, y_mm: int) -> None:
    """Head for the goal if the way is free, else along the route; search it if it is blocked."""
    goal_x_mm, goal_y_mm = goal_of(memory)
    cells = max(abs(goal_x_mm - x_mm), abs(goal_y_mm - y_mm)) // SIDE_MM + 1
    line = grid.line_cost(x_mm, y_mm, goal_x_mm, goal_y_mm)
    memory.sees_goal = 0 < line <= cells * DIRECT + DIRECT_MORE
    if memory.sees_goal:
        memory.route, memory.hopeless = None, 0
        memory.target_x_mm, memory.target_y_mm = goal_x_mm, goal_y_mm
        return
    if 0 < memory.hopeless < CONFIRM:
        memory.hopeless += 1
        return
    route = memory.route
    if route is not None:
        at = place_on(route, memory.at, x_mm, y_mm)
        if at is None or not is_still_good(grid, route, at):
            route = None
        else:
            memory.at = at
    if route is None:
        route, memory.at = find_route(grid, x_mm, y_mm, goal_x_mm, goal_y_mm), 0
        memory.route = route
    if route is None:
        give_up(memory, grid)
        return
    memory.hopeless = 0
    memory.target_x_mm, memory.target_y_mm = target_on(grid, route, memory.at, x_mm, y_mm)


def give_up(memory: OracleMemory, grid: GridMap) -> None:
    """Doubt what was not confirmed; give up if the rest of the map still proves it."""
    if memory.doubts < MAX_DOUBTS and grid.doubt():
        memory.doubts += 1
        return
    memory.given_up = memory.hopeless == CONFIRM
    memory.hopeless = 1


def away_from_flank(ring: Ring, turn_rad: float) -> float:
    """Return a turn that leads away from a flank that almost touches an obstacle."""
    turn_rad = wrap(turn_rad)
    right_m, left_m = (min(range_of(ring, i) for i in sonars) for sonars in FLANKS)
    if right_m < FLANK_M <= left_m:
        return max(turn_rad, AWAY_RAD)
    if left_m < FLANK_M <= right_m:
        return min(turn_rad, -AWAY_RAD)
    return turn_rad


def range_of(ring: Ring, sonar: int) -> float:
    """Return a range, FLANK_M if it is missing."""
    range_m = ring.range_m[sonar]
    return FLANK_M if range_m is None else range_m


def decision(memory: OracleMemory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Return the decision: the goal turned to the heading of the target, and the speed limit."""
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    goal_rad = atan2(dy_m, dx_m)
    alpha_rad = wrap(goal_rad - pose.heading_rad)
    gamma_rad = 0.0
    branch: int = states.TO_GOAL
    if not memory.sees_goal:
        to_x_m, to_y_m = 0.001 * memory.target_x_mm, 0.001 * memory.target_y_mm
        gamma_rad = wrap(atan2(to_y_m - pose.y_m, to_x_m - pose.x_m) - goal_rad)
        if abs(gamma_rad) > SMALL_TURN_RAD:
            branch = states.PASS_LEFT if gamma_rad > 0.0 else states.PASS_RIGHT
    if memory.given_up:
        branch = states.GIVE_UP
    pace.hold(memory.held, ring)
    off_rad = pace.keep_off(memory.held)
    if off_rad != 0.0:
        gamma_rad = wrap(away_from_flank(ring, alpha_rad + gamma_rad + off_rad) - alpha_rad)
    speed_m_s = pace.speed(memory.held, FREE_MM, wrap(alpha_rad + gamma_rad), params)
    speed_m_s = closing_speed.limit_m_s(ring, speed_m_s)
    if memory.hopeless:
        speed_m_s = 0.0
    cosine, sine = cos_sin(gamma_rad)
    return Decision(
        branch,
        sonar_ring.bearing_rad(ring),
        ring.nearest_m,
        alpha_rad,
        gamma_rad,
        pose.x_m + cosine * dx_m - sine * dy_m,
        pose.y_m + sine * dx_m + cosine * dy_m,
        speed_m_s,
    )


STUDY_NAVIGATORS: Final[Mapping[int, Navigator]] = MappingProxyType(
    {ORACLE_GRID: Navigator(OracleMemory, step, True)}
)


@contextmanager
def registered(number: int) -> Iterator[None]:
    """Register a navigator if it is for studies only, and remove it afterwards."""
    if number not in STUDY_NAVIGATORS or number in NAVIGATORS:
        yield
        return
    NAVIGATORS[number] = STUDY_NAVIGATORS[number]
    try:
        yield
    finally:
        del NAVIGATORS[number]
