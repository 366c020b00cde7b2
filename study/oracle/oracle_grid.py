"""The navigator `oracle_grid`: a map of unlimited size, and the shortest route through it.

It has the sensors of the other navigators, and means that the robot does not have. Unknown cells
count as free, and the route is searched again when the map contradicts it.
"""

from math import pi
from typing import Final

import numpy as np

from robot.core import states
from robot.core.geometry import wrap
from robot.core.motion import pace
from robot.core.parameters import Params
from robot.core.perception import sonar_ring as rings
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Decision, Goal, Pose
from runtime.elementary import atan2, cos_sin, hypot
from study.oracle import evidence as evidences
from study.oracle.cones import CELL_MM, CIRCLE, REACH_MM, Ints
from study.oracle.evidence import Evidence
from study.oracle.route import DIAGONAL, STRAIGHT, search
from study.oracle.terrain import FREE, PART, SIDE_MM, Terrain, change, price, price_all, terrain_of

BRADS: Final = CIRCLE / (2.0 * pi)
EVERY_TICKS: Final = 2
ROOM_MM: Final = 4000
"""Width of unknown floor around start, goal and robot that a route may use."""
ROOM_LEFT_MM: Final = REACH_MM + 500

FAR_MM: Final = 10_000
OWN_MM: Final = 160
"""Around the robot, blocked cells can be left at OWN_COST; less than a wall and two radii."""
OWN_COST: Final = 40
BESIDE_MM: Final = 350
"""Farther from the route the robot searches another one."""
DEARER: Final = 1.3
DEARER_BY: Final = 60 * FREE * STRAIGHT // 4
LOOK: Final = 24
AHEAD: Final = (120, 80, 60, 45, 34, 25, 18, 13, 9, 6, 4)
"""Cells ahead on the route that the robot tries to head for in a straight line."""
EQUAL: Final = 1.05
STRAIGHT_ENOUGH: Final = 0.17
MAX_STILL: Final = 30
STILL_MM: Final = 20
BLOCK_MM: Final = 25
BLOCKED_SCORE: Final = 40
CONFIRMED: Final = 10
DOUBTED: Final = 6
MAX_DOUBTS: Final = 6
CONFIRM: Final = 15
"""Updates for which there must be no route."""


class Memory:
    """The map, the route with the costs so far at its cells, and where on it the robot is."""

    def __init__(self) -> None:
        self.side: int = states.LEFT
        self.goal_x_m = self.goal_y_m = 0.0
        self.evidence: Evidence | None = None
        self.terrain: Terrain | None = None
        self.route: Ints | None = None
        self.route_x_mm: Ints | None = None
        self.route_y_mm: Ints | None = None
        self.route_cost: Ints | None = None
        self.at = 0
        self.target_x_m = self.target_y_m = 0.0
        self.sees_goal = False
        self.given_up = False
        self.ticks = self.doubts = self.hopeless = self.still = self.searches = 0
        self.still_x_mm = self.still_y_mm = 0


def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Return where to drive and the speed limit; GIVE_UP if the map proves that no way exists."""
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    if goal.x_m != memory.goal_x_m or goal.y_m != memory.goal_y_m or memory.evidence is None:
        begin(memory, x_mm, y_mm, goal)
    if memory.ticks % EVERY_TICKS == 0 and not memory.given_up:
        look(memory, x_mm, y_mm, pose, ring, params)
        choose(memory, x_mm, y_mm, pose, goal, params)
    memory.ticks += 1
    return decision(memory, pose, ring, goal, params)


def begin(memory: Memory, x_mm: int, y_mm: int, goal: Goal) -> None:
    """Start with an empty map for a new goal."""
    memory.goal_x_m, memory.goal_y_m = goal.x_m, goal.y_m
    memory.given_up = False
    memory.route, memory.doubts, memory.hopeless = None, 0, 0
    goal_x_mm, goal_y_mm = int(1000.0 * goal.x_m), int(1000.0 * goal.y_m)
    grid = grid_around(
        min(x_mm, goal_x_mm), min(y_mm, goal_y_mm), max(x_mm, goal_x_mm), max(y_mm, goal_y_mm)
    )
    memory.evidence, memory.terrain = grid, Terrain(grid)


def grid_around(low_x_mm: int, low_y_mm: int, high_x_mm: int, high_y_mm: int) -> Evidence:
    """Return an empty map of a rectangle with ROOM_MM around it; its corners are whole cells."""
    left, low = ((each - ROOM_MM) // SIDE_MM * PART for each in (low_x_mm, low_y_mm))
    right, high = ((each + ROOM_MM) // SIDE_MM * PART for each in (high_x_mm, high_y_mm))
    return Evidence(left, low, right - left, high - low)


def make_room(memory: Memory, x_mm: int, y_mm: int) -> None:
    """Extend the map if the robot is near its rim."""
    old = memory.evidence
    assert old is not None
    left_mm, low_mm = old.left * CELL_MM, old.low * CELL_MM
    right_mm, high_mm = left_mm + old.width * CELL_MM, low_mm + old.height * CELL_MM
    if (
        left_mm + ROOM_LEFT_MM < x_mm < right_mm - ROOM_LEFT_MM
        and low_mm + ROOM_LEFT_MM < y_mm < high_mm - ROOM_LEFT_MM
    ):
        return
    new = grid_around(
        min(x_mm, left_mm + ROOM_MM),
        min(y_mm, low_mm + ROOM_MM),
        max(x_mm, right_mm - ROOM_MM),
        max(y_mm, high_mm - ROOM_MM),
    )
    rows = new.score.reshape(new.height, new.width)
    row, column = old.low - new.low, old.left - new.left
    scores = old.score.reshape(old.height, old.width)
    rows[row : row + old.height, column : column + old.width] = scores
    memory.evidence, memory.route = new, None
    memory.terrain = terrain_of(new)


def look(
    memory: Memory, x_mm: int, y_mm: int, pose: Pose, ring: Ring, params: Params
) -> None:
    """Take the echoes into the map, and note a place where the robot is held up."""
    make_room(memory, x_mm, y_mm)
    evidence, terrain = memory.evidence, memory.terrain
    assert evidence is not None and terrain is not None
    radius_mm = int(1000.0 * params.radius_m)
    heading = int(BRADS * pose.heading_rad)
    cells, before = evidences.update(evidence, x_mm, y_mm, heading, ring, radius_mm)
    changed = change(terrain, evidence, cells, before)
    if is_held_up(memory, x_mm, y_mm):
        away_mm = radius_mm + BLOCK_MM
        dx_m, dy_m = memory.target_x_m - pose.x_m, memory.target_y_m - pose.y_m
        cosine, sine = cos_sin(atan2(dy_m, dx_m))
        mark(memory, x_mm + int(away_mm * cosine), y_mm + int(away_mm * sine))
        changed = True
    if changed:
        at = cell_of(memory, x_mm, y_mm)
        price(terrain, at % terrain.width, at // terrain.width)


def is_held_up(memory: Memory, x_mm: int, y_mm: int) -> bool:
    """Return whether the robot has not moved for MAX_STILL updates."""
    dx_mm, dy_mm = x_mm - memory.still_x_mm, y_mm - memory.still_y_mm
    memory.still += 1
    if not -STILL_MM < dx_mm < STILL_MM or not -STILL_MM < dy_mm < STILL_MM:
        memory.still_x_mm, memory.still_y_mm, memory.still = x_mm, y_mm, 0
    if memory.still <= MAX_STILL:
        return False
    memory.still = 0
    return True


def mark(memory: Memory, x_mm: int, y_mm: int) -> None:
    """Mark a place as occupied for long: the robot cannot drive there."""
    evidence, terrain = memory.evidence, memory.terrain
    assert evidence is not None and terrain is not None
    at = evidence.index(x_mm, y_mm)
    cells = np.array([at, at - 1, at + 1, at - evidence.width, at + evidence.width])
    before = evidence.score[cells]
    evidence.score[cells] = BLOCKED_SCORE
    change(terrain, evidence, cells, before)


def cell_of(memory: Memory, x_mm: int, y_mm: int) -> int:
    """Return the index of the cell of terrain of a place."""
    evidence, terrain = memory.evidence, memory.terrain
    assert evidence is not None and terrain is not None
    row = y_mm // SIDE_MM - evidence.low // PART
    return row * terrain.width + x_mm // SIDE_MM - evidence.left // PART


def choose(
    memory: Memory, x_mm: int, y_mm: int, pose: Pose, goal: Goal, params: Params
) -> None:
    """Head for the goal if the way is free, else along the route; search it if it is blocked."""
    goal_x_mm, goal_y_mm = int(1000.0 * goal.x_m), int(1000.0 * goal.y_m)
    length = max(abs(goal_x_mm - x_mm), abs(goal_y_mm - y_mm)) // SIDE_MM
    direct = line_cost(memory, x_mm, y_mm, goal_x_mm, goal_y_mm)
    memory.sees_goal = 0 < direct <= (length + 1) * STRAIGHT * FREE * 3 // 2 + DEARER_BY // 2
    if memory.sees_goal:
        memory.route = None
        memory.target_x_m, memory.target_y_m = goal.x_m, goal.y_m
        return
    if not is_on_route(memory, x_mm, y_mm) and not find_route(
        memory, x_mm, y_mm, goal_x_mm, goal_y_mm
    ):
        give_up(memory)
        return
    memory.hopeless = 0
    head_along(memory, x_mm, y_mm)


def line_cost(memory: Memory, x_mm: int, y_mm: int, to_x_mm: int, to_y_mm: int) -> int:
    """Return the cost of a straight line, 0 if it is blocked farther than OWN_MM from here."""
    evidence, terrain = memory.evidence, memory.terrain
    assert evidence is not None and terrain is not None
    dx_mm, dy_mm = to_x_mm - x_mm, to_y_mm - y_mm
    length_mm = int(hypot(dx_mm, dy_mm))
    steps = length_mm // CELL_MM + 1
    part = np.arange(1, steps + 1)
    columns = (x_mm + dx_mm * part // steps) // SIDE_MM - evidence.left // PART
    rows = (y_mm + dy_mm * part // steps) // SIDE_MM - evidence.low // PART
    cost = terrain.costs[rows * terrain.width + columns]
    if (cost[OWN_MM // CELL_MM :] == 0).any():
        return 0
    total = int(cost.sum(dtype=np.int64))
    return total * STRAIGHT * length_mm // (steps * SIDE_MM) + 1


def is_on_route(memory: Memory, x_mm: int, y_mm: int) -> bool:
    """Return whether the robot is on a route that has not become blocked or much dearer."""
    route, terrain = memory.route, memory.terrain
    if route is None or terrain is None:
        return False
    assert memory.route_x_mm is not None and memory.route_y_mm is not None
    assert memory.route_cost is not None
    near = slice(memory.at, memory.at + LOOK)
    dx_mm, dy_mm = memory.route_x_mm[near] - x_mm, memory.route_y_mm[near] - y_mm
    squares = dx_mm * dx_mm + dy_mm * dy_mm
    nearest = int(squares.argmin())
    if squares[nearest] > BESIDE_MM * BESIDE_MM:
        return False
    memory.at += nearest
    rest = route[memory.at :]
    cost = terrain.costs[rest]
    if (cost[OWN_MM // SIDE_MM :] == 0).any():
        return False
    planned = int(memory.route_cost[-1] - memory.route_cost[memory.at])
    now = int(cost.sum(dtype=np.int64)) * STRAIGHT
    return now <= planned * DEARER + DEARER_BY


def find_route(memory: Memory, x_mm: int, y_mm: int, goal_x_mm: int, goal_y_mm: int) -> bool:
    """Search the cheapest route; return whether there is one."""
    evidence, terrain = memory.evidence, memory.terrain
    assert evidence is not None and terrain is not None
    start, end = cell_of(memory, x_mm, y_mm), cell_of(memory, goal_x_mm, goal_y_mm)
    memory.searches += 1
    opened = open_cells(terrain, start, OWN_MM // SIDE_MM) + open_cells(terrain, end, 1)
    found = search(terrain.cost, terrain.width, start, end, FREE)
    for cell in opened:
        terrain.cost[cell] = 0
    if not found:
        memory.route = None
        return False
    route = np.array(found)
    columns, rows = route % terrain.width, route // terrain.width
    memory.route, memory.at = route, 0
    memory.route_x_mm = (columns + evidence.left // PART) * SIDE_MM + SIDE_MM // 2
    memory.route_y_mm = (rows + evidence.low // PART) * SIDE_MM + SIDE_MM // 2
    turns = (columns[1:] != columns[:-1]) & (rows[1:] != rows[:-1])
    cost = terrain.costs[route[1:]].astype(np.int64)
    cost[cost == 0] = OWN_COST
    lengths = np.where(turns, DIAGONAL, STRAIGHT)
    memory.route_cost = np.concatenate([[0], np.cumsum(cost * lengths)])
    return True


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


def give_up(memory: Memory) -> None:
    """Doubt what was not confirmed; give up if the rest of the map still proves it."""
    evidence = memory.evidence
    assert evidence is not None
    score = evidence.score
    doubtful = np.flatnonzero((score >= evidences.SURE) & (score < CONFIRMED))
    if len(doubtful) and memory.doubts < MAX_DOUBTS:
        memory.doubts += 1
        score[doubtful] = DOUBTED
        memory.terrain = terrain_of(evidence)
        return
    memory.hopeless += 1
    memory.given_up = memory.hopeless > CONFIRM


def head_along(memory: Memory, x_mm: int, y_mm: int) -> None:
    """Head for the farthest place of the route to which the straight line costs no more."""
    assert memory.route_x_mm is not None and memory.route_y_mm is not None
    assert memory.route_cost is not None
    last, costs = len(memory.route_x_mm) - 1, memory.route_cost
    to = min(memory.at + AHEAD[-1] - 1, last)
    for ahead in AHEAD:
        place = min(memory.at + ahead, last)
        target = int(memory.route_x_mm[place]), int(memory.route_y_mm[place])
        line = line_cost(memory, x_mm, y_mm, *target)
        if 0 < line <= EQUAL * int(costs[place] - costs[memory.at]) + FREE * STRAIGHT:
            to = place
            break
    memory.target_x_m = 0.001 * int(memory.route_x_mm[to])
    memory.target_y_m = 0.001 * int(memory.route_y_mm[to])


def decision(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Return the decision: the goal turned to the heading of the target, and the speed limit."""
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    goal_rad = atan2(dy_m, dx_m)
    alpha_rad = wrap(goal_rad - pose.heading_rad)
    gamma_rad = 0.0
    if not memory.sees_goal:
        target_rad = atan2(memory.target_y_m - pose.y_m, memory.target_x_m - pose.x_m)
        gamma_rad = wrap(target_rad - goal_rad)
    branch: int = states.TO_GOAL
    if memory.given_up:
        branch = states.GIVE_UP
    elif not memory.sees_goal and abs(gamma_rad) > STRAIGHT_ENOUGH:
        branch = states.PASS_LEFT if gamma_rad > 0.0 else states.PASS_RIGHT
    off_rad = pace.keep_off(ring)
    if off_rad != 0.0:
        gamma_rad = wrap(gamma_rad + off_rad)
    speed_m_s = pace.speed(ring, FAR_MM, wrap(alpha_rad + gamma_rad), params)
    if memory.hopeless:
        speed_m_s = 0.0
    cosine, sine = cos_sin(gamma_rad)
    return Decision(
        branch,
        rings.bearing_rad(ring),
        ring.nearest_m,
        alpha_rad,
        gamma_rad,
        pose.x_m + cosine * dx_m - sine * dy_m,
        pose.y_m + sine * dx_m + cosine * dy_m,
        speed_m_s,
    )
