"""Families of cells with walls between them: mazes, offices, and maps in Moving AI's style."""

from collections.abc import Callable, Iterator, Mapping
from math import pi
from typing import Final, NamedTuple, TypeAlias

from plant.corpus.draft import RIM_M, ShapeFrame, WorldDraft, any_angle, thickness
from plant.model.draws import Draws
from protocol.ring import RADIUS_M
from protocol.world import Obstacle, Point
from runtime.elementary import cos, sin

Cell: TypeAlias = tuple[int, int]
Doors: TypeAlias = set[frozenset[Cell]]

SHARE_TURNED: Final = 0.6


class Plan(NamedTuple):
    """A building of equal cells: number, size, and the pairs of neighbours that are connected."""

    columns: int
    rows: int
    cell_m: Point
    doors: Doors

    def cells(self) -> list[Cell]:
        """Return all cells."""
        return [(column, row) for row in range(self.rows) for column in range(self.columns)]

    def centre(self, cell: Cell) -> Point:
        """Return the centre of a cell."""
        return (cell[0] + 0.5) * self.cell_m[0], (cell[1] + 0.5) * self.cell_m[1]

    @property
    def size_m(self) -> Point:
        """The size of the building."""
        return self.columns * self.cell_m[0], self.rows * self.cell_m[1]


class Site(NamedTuple):
    """Position of a building: alone on its floor, or rotated on a larger floor, inside a shell."""

    size_m: Point
    frame: ShapeFrame
    shell: tuple[Obstacle, ...]


def maze(random: Draws) -> WorldDraft:
    """Draw a maze with corridors of 0.6 to 1.0 m and few or no loops."""
    plan = maze_plan(random, random.randint(5, 8), random.randint(5, 8))
    start, goal = apart(random, plan)
    return maze_draft(random, plan, start, goal)


def maze_plan(random: Draws, columns: int, rows: int) -> Plan:
    """Draw the plan of a maze."""
    cell_m = round(random.uniform(0.6, 1.0), 2)
    return Plan(columns, rows, (cell_m, cell_m), carved(random, columns, rows, random.random() / 6))


def maze_draft(random: Draws, plan: Plan, start: Cell, goal: Cell) -> WorldDraft:
    """Return a maze with start and goal in the given cells."""
    thick_m = round(random.uniform(0.02, 0.06), 3)
    site = site_for(random, plan, thick_m)
    walls = [site.frame.wall(thick_m, a, b) for a, b in wall_lines(plan)]
    from_m, to_m = (site.frame.point(*plan.centre(cell)) for cell in (start, goal))
    return WorldDraft(site.size_m, from_m, to_m, (*site.shell, *walls))


def office(random: Draws) -> WorldDraft:
    """Draw four to nine rooms with doors of 0.5 to 0.9 m, some with furniture."""
    plan = office_plan(random)
    start, goal = apart(random, plan)
    return office_draft(random, plan, start, goal)


def office_plan(random: Draws) -> Plan:
    """Draw the plan of an office."""
    columns, rows = random.randint(2, 3), random.randint(2, 3)
    cell_m = (round(random.uniform(1.7, 2.8), 2), round(random.uniform(1.7, 2.8), 2))
    return Plan(columns, rows, cell_m, carved(random, columns, rows, 0.4))


def office_draft(random: Draws, plan: Plan, start: Cell, goal: Cell) -> WorldDraft:
    """Return an office with start and goal in the given cells."""
    thick_m = thickness(random)
    site = site_for(random, plan, thick_m)
    inner: list[Obstacle] = []
    for a, b, open_ in borders(plan):
        inner += _wall_with_door(random, site.frame, thick_m, a, b) if open_ else ()
        if not open_:
            inner.append(site.frame.wall(thick_m, a, b))
    from_m, to_m = (site.frame.point(*_somewhere(random, plan, cell)) for cell in (start, goal))
    for cell in plan.cells():
        if random.random() < 0.5:
            inner.append(_furniture(random, plan, cell, site.frame))
    return WorldDraft(site.size_m, from_m, to_m, (*site.shell, *inner))


FLEET_GAP_M: Final = 0.96
"""Free between robots at their starts and goals.

After a drive of 13 m, dead reckoning is wrong by 0.2 to 0.4 m sideways. With this gap, robots that
have arrived still leave a way between them, and no goal is under another robot or beyond a wall.
"""
PITCH_M: Final = 2.0 * RADIUS_M + FLEET_GAP_M
APRON_M: Final = round(5 * PITCH_M + 0.3, 2)
"""Free floor on both sides of the shelves, where five ranks of robots fit."""
HALL_M: Final = round(21 * PITCH_M + 0.6, 2)
"""Width, so that a rank has 21 robots."""


def warehouse(random: Draws) -> WorldDraft:
    """Draw rows of shelves between two aprons, with room for a hundred robots on each of them.

    Aisles are 1.6 to 2.2 m wide, the outermost up to twice as wide. A cross aisle divides the rows.
    """
    aisle_m, depth_m = round(random.uniform(1.6, 2.2), 2), round(random.uniform(0.4, 0.7), 2)
    shelf_m, cross_m = round(random.uniform(2.0, 3.0), 2), round(random.uniform(1.6, 2.2), 2)
    rows = int((HALL_M - aisle_m) / (aisle_m + depth_m))
    first_m = round((HALL_M - rows * (aisle_m + depth_m) + aisle_m) / 2.0, 3)
    long_m = round(2.0 * (APRON_M + shelf_m) + cross_m, 2)
    frame = ShapeFrame((APRON_M, first_m), 0.0)
    lows_m = [row * (aisle_m + depth_m) for row in range(rows)]
    shelves = tuple(
        frame.box(left_m, low_m, left_m + shelf_m, low_m + depth_m)
        for low_m in lows_m
        for left_m in (0.0, shelf_m + cross_m)
    )
    middle_m = HALL_M / 2.0
    start, goal = (APRON_M / 2.0, middle_m), (round(long_m - APRON_M / 2.0, 3), middle_m)
    return WorldDraft((long_m, HALL_M), start, goal, shelves)


def _wall_with_door(
    random: Draws, frame: ShapeFrame, thick_m: float, a: Point, b: Point
) -> tuple[Obstacle, Obstacle]:
    length_m = abs(b[0] - a[0]) + abs(b[1] - a[1])
    wide_m = random.uniform(0.5, 0.9) + thick_m
    low_m = random.uniform(0.15, length_m - wide_m - 0.15)
    ends = [(a, low_m / length_m), (b, 1.0 - (low_m + wide_m) / length_m)]
    (_, near), (_, far) = ends
    to_door = (a[0] + near * (b[0] - a[0]), a[1] + near * (b[1] - a[1]))
    from_door = (b[0] - far * (b[0] - a[0]), b[1] - far * (b[1] - a[1]))
    return frame.wall(thick_m, a, to_door), frame.wall(thick_m, from_door, b)


def _somewhere(random: Draws, plan: Plan, cell: Cell) -> Point:
    x_m, y_m = plan.centre(cell)
    return (
        x_m + random.uniform(-0.35, 0.35) * plan.cell_m[0],
        y_m + random.uniform(-0.35, 0.35) * plan.cell_m[1],
    )


def _furniture(random: Draws, plan: Plan, cell: Cell, frame: ShapeFrame) -> Obstacle:
    x_m, y_m = _somewhere(random, plan, cell)
    if random.random() < 0.5:
        return frame.disc(x_m, y_m, random.uniform(0.08, 0.25))
    half_x_m, half_y_m = random.uniform(0.1, 0.35), random.uniform(0.1, 0.25)
    return frame.box(x_m - half_x_m, y_m - half_y_m, x_m + half_x_m, y_m + half_y_m)


def carved(random: Draws, columns: int, rows: int, loops: float) -> Doors:
    """Return openings that connect all cells, and a share `loops` of the remaining ones."""
    doors: Doors = set()
    trail = [(random.randrange(columns), random.randrange(rows))]
    seen = set(trail)
    while trail:
        fresh = [one for one in neighbours(trail[-1], columns, rows) if one not in seen]
        if not fresh:
            trail.pop()
            continue
        after = random.choice(fresh)
        doors.add(frozenset((trail[-1], after)))
        seen.add(after)
        trail.append(after)
    for row in range(rows):
        for column in range(columns):
            for other in ((column + 1, row), (column, row + 1)):
                if other[0] < columns and other[1] < rows and random.random() < loops:
                    doors.add(frozenset(((column, row), other)))
    return doors


def neighbours(cell: Cell, columns: int, rows: int) -> list[Cell]:
    """Return the neighbours of a cell."""
    column, row = cell
    beside = ((column - 1, row), (column + 1, row), (column, row - 1), (column, row + 1))
    return [one for one in beside if 0 <= one[0] < columns and 0 <= one[1] < rows]


def apart(random: Draws, plan: Plan) -> tuple[Cell, Cell]:
    """Return two cells at least half the building apart."""
    least = (plan.columns + plan.rows) // 2 - 1
    pairs = [
        (a, b)
        for a in plan.cells()
        for b in plan.cells()
        if abs(a[0] - b[0]) + abs(a[1] - b[1]) >= least and a != b
    ]
    return random.choice(pairs)


def borders(plan: Plan) -> Iterator[tuple[Point, Point, bool]]:
    """Yield the line between any two neighbours, and whether they are connected."""
    (wide_m, high_m), doors = plan.cell_m, plan.doors
    for column, row in plan.cells():
        right, above = (column + 1, row), (column, row + 1)
        x_m, y_m = right[0] * wide_m, above[1] * high_m
        if right[0] < plan.columns:
            yield (x_m, y_m - high_m), (x_m, y_m), frozenset(((column, row), right)) in doors
        if above[1] < plan.rows:
            yield (x_m - wide_m, y_m), (x_m, y_m), frozenset(((column, row), above)) in doors


def wall_lines(plan: Plan) -> list[tuple[Point, Point]]:
    """Return the walls between unconnected cells, each as long as possible."""
    shut = sorted((a, b) for a, b, open_ in borders(plan) if not open_)
    lines: list[tuple[Point, Point]] = []
    upright = [(a, b) for a, b in shut if a[0] == b[0]]
    level = sorted(((a, b) for a, b in shut if a[1] == b[1]), key=lambda line: line[0][::-1])
    for a, b in (*upright, *level):
        if lines and lines[-1][1] == a and (lines[-1][0][0] == b[0] or lines[-1][0][1] == b[1]):
            lines[-1] = (lines[-1][0], b)
        else:
            lines.append((a, b))
    return lines


def site_for(random: Draws, plan: Plan, thick_m: float) -> Site:
    """Return a site that fills its floor, or a rotated one inside a shell."""
    wide_m, high_m = plan.size_m
    if random.random() >= SHARE_TURNED:
        return Site((round(wide_m, 3), round(high_m, 3)), ShapeFrame((0.0, 0.0), 0.0), ())
    angle_rad = any_angle(random)
    c, s = cos(angle_rad), sin(angle_rad)
    corners = ((0.0, 0.0), (wide_m, 0.0), (wide_m, high_m), (0.0, high_m))
    turned = [(c * x - s * y, s * x + c * y) for x, y in corners]
    low = [min(values) - RIM_M for values in zip(*turned, strict=True)]
    high = [max(values) + RIM_M for values in zip(*turned, strict=True)]
    frame = ShapeFrame((-low[0], -low[1]), angle_rad % (2.0 * pi))
    size_m = (round(high[0] - low[0], 3), round(high[1] - low[1], 3))
    return Site(size_m, frame, (frame.wall(thick_m, *corners, corners[0]),))


FEWEST_CELLS: Final = 20
MAX_CELLS: Final = 32
FREE, BLOCKED = ".", "@"


def grid_maze(random: Draws) -> str:
    """Draw corridors one or two cells wide, with walls of one cell and few or no loops."""
    wide = random.randint(1, 2)
    columns, rows = (_count(random, wide + 1) for _ in range(2))
    doors = carved(random, columns, rows, random.choice((0.0, 0.05)))
    grid = _blocked((wide + 1) * columns + 1, (wide + 1) * rows + 1)
    for row in range(rows):
        for column in range(columns):
            left, low = column * (wide + 1) + 1, row * (wide + 1) + 1
            right = frozenset(((column, row), (column + 1, row))) in doors
            up = frozenset(((column, row), (column, row + 1))) in doors
            _clear(grid, left, low, wide + right, wide)
            _clear(grid, left, low, wide, wide + up)
    return _text(grid)


def grid_rooms(random: Draws) -> str:
    """Draw rooms of 3 to 7 cells a side with doors of one cell."""
    side = random.randint(3, 7)
    columns, rows = (_count(random, side + 1) for _ in range(2))
    doors = carved(random, columns, rows, 0.3)
    grid = _blocked((side + 1) * columns + 1, (side + 1) * rows + 1)
    for row in range(rows):
        for column in range(columns):
            left, low = column * (side + 1) + 1, row * (side + 1) + 1
            _clear(grid, left, low, side, side)
            if frozenset(((column, row), (column + 1, row))) in doors:
                _clear(grid, left + side, low + random.randrange(side), 1, 1)
            if frozenset(((column, row), (column, row + 1))) in doors:
                _clear(grid, left + random.randrange(side), low + side, 1, 1)
    return _text(grid)


def grid_random(random: Draws) -> str:
    """Draw 10 to 35 % blocked cells."""
    columns, rows = _side(random), _side(random)
    share = random.uniform(0.10, 0.35)
    cells = [BLOCKED] * round(share * columns * rows)
    cells += [FREE] * (columns * rows - len(cells))
    random.shuffle(cells)
    return _text([cells[row * columns : (row + 1) * columns] for row in range(rows)])


MAPS: Final[Mapping[str, Callable[[Draws], str]]] = {
    "grid_maze": grid_maze,
    "grid_rooms": grid_rooms,
    "grid_random": grid_random,
}


def _side(random: Draws) -> int:
    return random.randint(FEWEST_CELLS, MAX_CELLS)


def _count(random: Draws, pitch: int) -> int:
    """Draw the number of cells of a side: a multiple of the pitch, and a last wall."""
    return random.randint(-(-(FEWEST_CELLS - 1) // pitch), (MAX_CELLS - 1) // pitch)


def _blocked(columns: int, rows: int) -> list[list[str]]:
    return [[BLOCKED] * columns for _ in range(rows)]


def _clear(grid: list[list[str]], left: int, low: int, columns: int, rows: int) -> None:
    for row in grid[low : low + rows]:
        row[left : left + columns] = [FREE] * columns


def _text(grid: list[list[str]]) -> str:
    head = ["type octile", f"height {len(grid)}", f"width {len(grid[0])}", "map"]
    return "\n".join([*head, *("".join(row) for row in grid)]) + "\n"
