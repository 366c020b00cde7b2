"""The map of `oracle_grid`: evidence, terrain, and the shortest route over it.

Each sonar's cone is one slice of the cells around the robot, sorted by bearing. The tables are
integers, made of sums, products, quotients and square roots only, so they are the same on every
machine.

A cone gives the distance of the nearest surface, not its bearing. So an echo is evidence for the
cells (of 2 cm) of its arc that no longer echo has passed, and the fewer these are, the stronger it
is. An arc that contains a certain cell is explained by it. Terrain has cells of 4 cm with the cost
of driving through them; A* with whole numbers finds the route. The map grows as the robot gets near
its rim.
"""

from functools import lru_cache
from heapq import heappop, heappush
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robot.core.perception.echoes import CIRCLE, CONE, QUARTER
from robot.core.perception.sonar_ring import Ring
from robot.core.ring import SONARS
from robot.core.values import EVERY
from runtime.elementary import Q1, Q2, Q3, Q4, Q5, hypot

Ints: TypeAlias = NDArray[np.int64]
Shorts: TypeAlias = NDArray[np.int16]

CELL_MM: Final = 20
REACH_MM: Final = 1500
"""Largest distance of a cell that an echo changes, from the robot's centre."""

SHARES: Final = 2
"""The tables are for robots at the centre of one of SHARES x SHARES parts of a cell."""


class Cones(NamedTuple):
    """Cells by bearing, three times round; `first[b + CIRCLE]` is the first one from bearing b.

    `offset` is that of the index, and `distance_mm` is from the robot's centre.
    """

    offset: Ints
    distance_mm: Shorts
    first: list[int]


@lru_cache(maxsize=4 * SHARES * SHARES)
def cones_of(share_x: int, share_y: int, width: int) -> Cones:
    """Return the cells around a robot in one of the parts of its cell, in rows of `width`."""
    reach = REACH_MM // CELL_MM
    side = np.arange(-reach, reach + 1)
    x, y = (each.ravel() for each in np.meshgrid(side, side))
    part_mm = CELL_MM // SHARES
    x_mm = x * CELL_MM + (CELL_MM - part_mm) // 2 - share_x * part_mm
    y_mm = y * CELL_MM + (CELL_MM - part_mm) // 2 - share_y * part_mm
    distance_mm = np.sqrt((x_mm * x_mm + y_mm * y_mm).astype(np.float64)).astype(np.int16)
    near = distance_mm <= REACH_MM
    x, y, distance_mm = x[near], y[near], distance_mm[near]
    bearing = brads(x_mm[near], y_mm[near])
    order = np.argsort(bearing, kind="stable")
    bearing = bearing[order]
    thrice = np.concatenate([bearing - CIRCLE, bearing, bearing + CIRCLE])
    first = np.searchsorted(thrice, np.arange(-CIRCLE, 2 * CIRCLE))
    offset, away_mm = (y * width + x)[order], distance_mm[order]
    return Cones(np.concatenate([offset] * 3), np.concatenate([away_mm] * 3), first.tolist())


def brads(x_mm: Ints, y_mm: Ints) -> Ints:
    """Return bearings from 0 to CIRCLE - 1, as those of `coarse_atan2`."""
    along, across = np.abs(x_mm).astype(np.float64), np.abs(y_mm).astype(np.float64)
    steep = across > along
    tangent = np.where(steep, along, across) / np.maximum(np.maximum(along, across), 1.0)
    z = tangent * tangent
    angle_rad = tangent * (Q1 - z * (Q2 - z * (Q3 - z * (Q4 - z * Q5))))
    bearing = np.floor(angle_rad * (QUARTER / 1.5707963267948966) + 0.5).astype(np.int64)
    bearing = np.where(steep, QUARTER - bearing, bearing)
    bearing = np.where(x_mm < 0, 2 * QUARTER - bearing, bearing)
    return np.where(y_mm < 0, -bearing, bearing) % CIRCLE


SURE: Final = 7
"""Least score of a cell that is certainly occupied."""
MAYBE: Final = 1
MOST: Final = 12
PASSED: Final = -3
"""Largest score of a cell that is certainly free: an echo does not come from there."""
LEAST_NEAR: Final = -6
LEAST_FAR: Final = -2
"""Least scores by echoes that pass nearer than FAR_MM, and farther: a post fits between rays."""
FAR_MM: Final = 900

SLACK_MM: Final = 15
SLACK_SHARE: Final = 50
"""A longer echo proves cells nearer by this slack, and by this share of the range, to be free."""
BAND_MM: Final = 14
FEW: Final = 10
SOME: Final = 20
"""Numbers of cells of an arc: FEW are 14 cm, SOME are 29 cm."""
BY_FEW: Final = 4
BY_SOME: Final = 2
MOST_SOME: Final = 6
MOST_MANY: Final = 3
CHANGED: Final = 2
"""Additional scores of the cells of an arc; with many of them the score stays at MOST_MANY."""

FOOT_MM: Final = 100
UNDERFOOT: Final = 4
"""Where the robot's body is there is no obstacle."""


class CellEvidence:
    """Scores of cells in rows of `width`; the first is at `left`, `low` in cells of the world."""

    def __init__(self, left: int, low: int, width: int, height: int) -> None:
        self.left, self.low, self.width, self.height = left, low, width, height
        self.score: Shorts = np.zeros(width * height, dtype=np.int16)

    def index(self, x_mm: int, y_mm: int) -> int:
        """Return the index of the cell of a place."""
        return (y_mm // CELL_MM - self.low) * self.width + x_mm // CELL_MM - self.left


def limits_of(ring: Ring, radius_mm: int) -> tuple[Shorts, Shorts]:
    """Return for each sonar the distance of its echo from the centre, and up to where it is free.

    Without a measurement both are negative; without an echo the first is beyond REACH_MM.
    """
    echo_mm, free_mm = [-REACH_MM] * SONARS, [-REACH_MM] * SONARS
    for i in EVERY:
        range_m = ring.range_m[i]
        if range_m is None:
            continue
        if range_m > 0.001 * REACH_MM:
            echo_mm[i] = free_mm[i] = 2 * REACH_MM
        else:
            range_mm = int(1000.0 * range_m)
            echo_mm[i] = range_mm + radius_mm
            free_mm[i] = echo_mm[i] - SLACK_MM - range_mm // SLACK_SHARE
    return np.array(echo_mm, dtype=np.int16), np.array(free_mm, dtype=np.int16)


def update_evidence(
    evidence: CellEvidence, x_mm: int, y_mm: int, heading: int, ring: Ring, radius_mm: int
) -> tuple[Ints, Shorts]:
    """Take the echoes of a ring at a pose, heading in brads.

    Return the cells whose score may have changed much, each once, and their scores before.
    """
    part_mm = CELL_MM // SHARES
    parts = x_mm % CELL_MM // part_mm, y_mm % CELL_MM // part_mm
    cones = cones_of(*parts, evidence.width)
    right = heading % CIRCLE - QUARTER + CIRCLE
    edges = [cones.first[right + CONE * i] for i in range(SONARS + 1)]
    low, high = edges[0], edges[SONARS]
    lengths = [edges[i + 1] - edges[i] for i in EVERY]
    echo_mm, free_mm = limits_of(ring, radius_mm)
    cells = cones.offset[low:high] + evidence.index(x_mm, y_mm)
    away_mm = cones.distance_mm[low:high]
    is_free = away_mm < np.repeat(free_mm, lengths)
    on_arc = np.flatnonzero(np.abs(away_mm - np.repeat(echo_mm, lengths)) <= BAND_MM)
    arcs = cells[on_arc]
    arcs_before = evidence.score[arcs]
    free, free_before = pass_through(evidence.score, cells[is_free], away_mm[is_free])
    ends = np.searchsorted(on_arc, np.array(edges) - low).tolist()
    for i in EVERY:
        if ends[i + 1] > ends[i]:
            take(evidence.score, arcs[ends[i] : ends[i + 1]])
    return np.concatenate([free, arcs]), np.concatenate([free_before, arcs_before])


def pass_through(score: Shorts, free: Ints, away_mm: Shorts) -> tuple[Ints, Shorts]:
    """Take the evidence of longer echoes; return the cells that may have been occupied."""
    here = score[free]
    least = np.where(away_mm < FAR_MM, LEAST_NEAR, LEAST_FAR)
    less = np.where(away_mm < FOOT_MM, UNDERFOOT, 1)
    score[free] = np.maximum(here - less, np.minimum(here, least))
    occupied = here >= MAYBE
    return free[occupied], here[occupied]


def take(score: Shorts, arc: Ints) -> None:
    """Take the evidence of one echo from the cells of its arc."""
    here = score[arc]
    sure = here >= SURE
    if sure.any():
        score[arc[sure]] = np.minimum(here[sure] + 1, MOST)
        return
    possible = here > PASSED
    count = int(np.count_nonzero(possible))
    if count == 0:
        score[arc] = here + CHANGED
        return
    more, most = 1, MOST_MANY
    if count <= FEW:
        more, most = BY_FEW, MOST
    elif count <= SOME:
        more, most = BY_SOME, MOST_SOME
    here = here[possible]
    score[arc[possible]] = np.maximum(here, np.minimum(here + more, most))


PART: Final = 2
"""Cells of evidence per cell of terrain along a side."""

SIDE_MM: Final = PART * CELL_MM
BLOCKED_MM: Final = 115
"""The robot's centre cannot be so near to an obstacle; the rest of its radius is rounding.

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

    def __init__(self, evidence: CellEvidence) -> None:
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


def change(terrain: Terrain, evidence: CellEvidence, cells: Ints, before: Shorts) -> bool:
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


def terrain_of(evidence: CellEvidence) -> Terrain:
    """Return the terrain of a map."""
    terrain = Terrain(evidence)
    cells = np.flatnonzero(evidence.score >= MAYBE)
    change(terrain, evidence, cells, np.zeros(len(cells), dtype=np.int16))
    price_all(terrain)
    return terrain


STRAIGHT: Final = 5
DIAGONAL: Final = 7
INDEX_BITS: Final = 24
INDEX: Final = (1 << INDEX_BITS) - 1
FARTHEST: Final = 1 << 40
DONE: Final = 256
AHEAD: Final = 257
"""Weights of the cost so far and of that ahead: of equal sums the one nearer to the end is first.

So a route may cost 1/256 more than the cheapest one.
"""


def search_route(cost: bytearray, width: int, start: int, end: int, least: int) -> list[int]:
    """Return the cells of the cheapest route with both ends; empty if there is none.

    A step costs its length times `cost` of the cell it enters, which is at least `least`; 0 is
    blocked. The cells of the rim must be blocked. The number of cells must be below 2^24.
    """
    columns, rows = away(width, end % width), away(len(cost) // width, end // width)
    steps = steps_of(width)
    best, before = [FARTHEST] * len(cost), [0] * len(cost)
    done = bytearray(len(cost))
    best[start] = 0
    waiting = [start]
    while waiting:
        here = heappop(waiting) & INDEX
        if done[here]:
            continue
        done[here] = 1
        if here == end:
            return way_of(before, start, end)
        gone = best[here]
        for step, length in steps:
            there = here + step
            each = cost[there]
            through = gone + length * each
            if each == 0 or through >= best[there]:
                continue
            best[there], before[there] = through, here
            dx, dy = columns[there % width], rows[there // width]
            rest = STRAIGHT * dx + 2 * dy if dx > dy else STRAIGHT * dy + 2 * dx
            total = DONE * through + AHEAD * rest * least
            heappush(waiting, (total << INDEX_BITS) + there)
    return []


def away(count: int, end: int) -> list[int]:
    """Return how far each column or row is from that of the end."""
    return [abs(place - end) for place in range(count)]


def steps_of(width: int) -> tuple[tuple[int, int], ...]:
    """Return the steps to the eight neighbours in rows of `width`, each with its length."""
    return (
        *((1, STRAIGHT), (-1, STRAIGHT), (width, STRAIGHT), (-width, STRAIGHT)),
        *((width + 1, DIAGONAL), (width - 1, DIAGONAL)),
        *((1 - width, DIAGONAL), (-1 - width, DIAGONAL)),
    )


def way_of(before: list[int], start: int, end: int) -> list[int]:
    """Return the cells from start to end."""
    way = [end]
    while way[-1] != start:
        way.append(before[way[-1]])
    way.reverse()
    return way


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
        self.evidence = CellEvidence(left, low, right - left, high - low)
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
        cells, before = update_evidence(self.evidence, x_mm, y_mm, heading, ring, radius_mm)
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
