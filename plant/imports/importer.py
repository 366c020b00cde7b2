"""Import worlds from a file of any supported format, chosen by its suffix.

Cells and cylinders become obstacles; start and goal are far apart and clear. The shortest path over
many cells takes two steps: A* over a grid of places, with moves in sixteen directions, finds a path
that is at most 2.8 % too long. Then the exact search of `plant.shortest_path` runs over corners
near that path only. The length is exact unless another route is shorter by less than that.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from math import ceil, inf, radians
from pathlib import Path
from typing import Final

import numpy as np

from plant.imports.barn import PITCH_M, CylinderField, load_grid, load_list
from plant.imports.cells import Cells, Labels, Mask, labelled, outlines, standing
from plant.imports.moving_ai import MovingAiScenario, fits, load_map, load_scenarios
from plant.imports.ros_bag import load_bag
from plant.imports.ros_map import load_ros_map
from plant.model.configuration import Body
from plant.model.draws import Draws
from plant.model.errors import WorldError, WorldProblem, WorldReport, refuse
from plant.model.geometry import clearance_m, distance_m, length_m
from plant.placement import STANDING_M, ObstacleFloor, check_places
from plant.shortest_path import near_path, shortest_path_m
from plant.world.reader import SIZE
from protocol.world import MAX_OBSTACLES, GoalPose, Obstacle, Point, Start, World
from runtime.elementary import hypot

HEADING_TOLERANCE_RAD: Final = radians(3.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedWorld:
    """Name and origin of a world; `file` is its name in errors.

    `start` and `goal` are on our floor, with its lower left corner at (0, 0); None: to be selected.
    `typed` are both as the user gave them, in the map's own frame.
    """

    file: str
    name: str
    family: str
    seed: int
    start: Point | None = None
    goal: Point | None = None
    typed: tuple[Point, Point] | None = None


def check_size(size_m: Point, file: str) -> None:
    """Raise WorldError for a floor that is too large or too small."""
    for side_m in size_m:
        if not SIZE.hold(side_m):
            reason = f"{size_m[0]:g} x {size_m[1]:g} m, a side must be {SIZE}"
            raise refuse(file, "size", reason, "take smaller cells, or a part with --window N")


def bare_world(
    size_m: Point,
    ends: tuple[Point, Point],
    obstacles: Sequence[Obstacle],
    made: ImportedWorld,
    random: Draws,
) -> World:
    """Return the world without its shortest path. Raises WorldError if a robot does not fit."""
    if len(obstacles) > MAX_OBSTACLES:
        reason = f"{len(obstacles)} obstacles, at most {MAX_OBSTACLES}"
        raise refuse(made.file, "size", reason, "take a part of it with --window N")
    heading_deg = round(random.uniform(-180.0, 180.0), 1)
    (start_x, start_y), (goal_x, goal_y) = ends
    start = Start(x_m=start_x, y_m=start_y, heading_rad=radians(heading_deg))
    goal = GoalPose(x_m=goal_x, y_m=goal_y, heading_tolerance_rad=HEADING_TOLERANCE_RAD)
    report = WorldReport(made.file, {})
    floor = ObstacleFloor(size_m, True, Body().radius_m, dict(enumerate(obstacles)))
    check_places(report, floor, start, goal)
    if report.problems:
        raise WorldError([in_the_map(problem, made) for problem in report.problems])
    return World(name=made.name, size_m=size_m, start=start, goal=goal, obstacles=tuple(obstacles))


def in_the_map(problem: WorldProblem, made: ImportedWorld) -> WorldProblem:
    """Return a problem of start or goal in the map's own frame, in which it was typed."""
    if made.typed is None:
        return problem._replace(line=None)
    end = problem.key.partition(".")[0]
    x_m, y_m = made.typed[end == "goal"]
    if "outside" in problem.reason:
        why = "is outside of the map"
    elif "inside" in problem.reason:
        why = "is in an obstacle"
    else:
        why = f"is nearer to an obstacle than the robot's radius of {Body().radius_m:g} m"
    fix = "choose a free place, in metres in the map's own frame"
    return WorldProblem(made.file, None, f"--{end}", f"({x_m:g}, {y_m:g}) {why}", fix)


def with_way(world: World, made: ImportedWorld, length_m: float | None) -> World:
    """Return the world with its shortest path, or with an unreachable goal."""
    return replace(
        world,
        family=made.family,
        family_seed=made.seed,
        shortest_path_m=None if length_m is None else round(length_m, 3),
        reachable=length_m is not None,
    )


ROUTE_PITCH_M: Final = 0.15
"""Largest distance of places; cells are divided into an odd number, so that one is central."""

ROUND_A_PLACE: Final = 3


class Places:
    """Possible positions of the robot's centre, on a grid finer than the cells."""

    def __init__(self, cells: Cells, radius_m: float) -> None:
        parts = ceil(cells.cell_m / ROUTE_PITCH_M)
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


PAIRS: Final = 6
MAX_PLACE_DRAWS: Final = 200
MIN_APART_M: Final = 1.0


def far_apart(cells: Cells, random: Draws, radius_m: float) -> tuple[Point, Point] | None:
    """Return the most distant of a few random pairs of connected cells."""
    rows, columns = np.nonzero(standing(cells, STANDING_M))
    if not len(rows):
        return None
    regions = _Regions(cells, radius_m)
    found: list[tuple[Point, Point]] = []
    for _ in range(MAX_PLACE_DRAWS):
        one, other = (random.randrange(len(rows)) for _ in range(2))
        start = cells.centre(int(rows[one]), int(columns[one]))
        goal = cells.centre(int(rows[other]), int(columns[other]))
        if distance_m(start, goal) >= MIN_APART_M and regions.joined(start, goal):
            found.append((start, goal))
        if len(found) == PAIRS:
            break
    return max(found, key=lambda pair: distance_m(*pair), default=None)


class _Regions:
    """Connected regions of places."""

    def __init__(self, cells: Cells, radius_m: float) -> None:
        self._places = Places(cells, radius_m)
        self._labels: Labels = labelled(self._places.free)

    def joined(self, a: Point, b: Point) -> bool:
        """Return whether a robot can drive between two points."""
        at_a, at_b = (self._places.nearest(point) for point in (a, b))
        if at_a is None or at_b is None:
            return False
        label = self._label(at_a)
        return label == self._label(at_b)

    def _label(self, number: int) -> int:
        return int(self._labels[self._places.cell(number)])


def grid_world(cells: Cells, made: ImportedWorld, random: Draws) -> World:
    """Return the world; WorldError if it is too large, or no robot fits at start or goal."""
    check_size(cells.size_m, made.file)
    ends = _ends_on_cells(cells, made, random)
    world = bare_world(cells.size_m, ends, outlines(cells), made, random)
    radius_m = Body().radius_m
    return with_way(world, made, route_m(world, Places(cells, radius_m), radius_m))


def _ends_on_cells(cells: Cells, made: ImportedWorld, random: Draws) -> tuple[Point, Point]:
    if made.start is not None and made.goal is not None:
        return made.start, made.goal
    found = far_apart(cells, random, Body().radius_m)
    if found is None:
        reason = f"no two places {STANDING_M:g} m from anything with a way between them"
        raise refuse(made.file, "start", reason, "make the cells larger with --cell, or the window")
    return found


MAX_CYLINDER_DRAWS: Final = 2000
MAX_PAIRS: Final = 30
"""Limit of the pairs searched: a path search costs more than drawing places."""


def cylinder_world(field: CylinderField, made: ImportedWorld, random: Draws) -> World:
    """Return the world; WorldError if it is too large, or no robot fits at start or goal."""
    check_size(field.size_m, made.file)
    if made.start is not None and made.goal is not None:
        world = bare_world(field.size_m, (made.start, made.goal), field.cylinders, made, random)
        return with_way(world, made, shortest_path_m(world))
    for _ in range(MAX_PAIRS):
        ends = _ends_among_cylinders(field, random)
        if ends is not None:
            world = bare_world(field.size_m, ends, field.cylinders, made, random)
            length_m = shortest_path_m(world)
            if length_m is not None:
                return with_way(world, made, length_m)
    reason = f"no two places {STANDING_M:g} m from anything with a way between them"
    raise refuse(made.file, "start", reason, "give --start and --goal")


def _ends_among_cylinders(field: CylinderField, random: Draws) -> tuple[Point, Point] | None:
    """Return the two most distant of a few free places."""
    free: list[Point] = []
    for _ in range(MAX_CYLINDER_DRAWS):
        x_m, y_m = (
            round(random.uniform(STANDING_M, side - STANDING_M), 3) for side in field.size_m
        )
        if all(clearance_m((x_m, y_m), cylinder) >= STANDING_M for cylinder in field.cylinders):
            free.append((x_m, y_m))
        if len(free) == 4:
            break
    pairs = [(a, b) for a in free for b in free if distance_m(a, b) >= MIN_APART_M]
    return max(pairs, key=lambda pair: distance_m(*pair), default=None)


CELL_M: Final = 0.4
MAX_STEM_LENGTH: Final = 40
BAG: Final = "bag"
"""Kind of a folder, which has no suffix."""

TAKES: Final = {
    ".map": ("cell", "start", "count", "window"),
    ".scen": ("cell", "count"),
    ".yaml": ("start", "count", "window"),
    ".yml": ("start", "count", "window"),
    ".npy": ("cell", "start"),
    ".csv": ("start", "count"),
    ".txt": ("start", "count"),
    ".mcap": ("cell", "start", "count", "window"),
    ".db3": ("cell", "start", "count", "window"),
    BAG: ("cell", "start", "count", "window"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """Options of an import. Start and goal are in the map's own frame, in metres.

    Without them the seed selects both. `window`: use a square part of the map with that many cells
    a side, also selected by the seed.
    """

    cell_m: float | None = None
    start: Point | None = None
    goal: Point | None = None
    seed: int = 1
    count: int = 1
    window: int | None = None


def import_worlds(path: Path, options: ImportOptions) -> Iterator[World]:
    """Yield the requested number of worlds; raise WorldError."""
    kind = BAG if path.is_dir() else path.suffix.lower()
    _check(path, kind, options)
    if kind == ".scen":
        yield from _of_scenarios(path, options)
    elif kind == ".npy":
        yield from _of_field(path, "barn", load_grid(path, options.cell_m or PITCH_M), options)
    elif kind in (".csv", ".txt"):
        yield from _of_field(path, "cylinders", load_list(path), options)
    elif kind in (".mcap", ".db3", BAG):
        yield from _of_cells(path, "ros_bag", load_bag(path, options.cell_m), options)
    elif kind == ".map":
        yield from _of_cells(path, "moving_ai", load_map(path, options.cell_m or CELL_M), options)
    else:
        yield from _of_cells(path, "ros_map", load_ros_map(path), options)


def _check(path: Path, kind: str, options: ImportOptions) -> None:
    """Refuse unknown kinds of files, and options that cannot be combined."""
    file = str(path)
    if kind not in TAKES:
        fix = "give the .yaml of a ROS map" if kind in (".pgm", ".png") else "give one of these"
        reason = f"no importer for {kind or 'a file without suffix'}; there are {', '.join(TAKES)}"
        raise refuse(file, "file", reason, fix)
    wished = {
        "cell": options.cell_m is not None,
        "start": options.start is not None or options.goal is not None,
        "count": options.count > 1,
        "window": options.window is not None,
    }
    for name, is_wished in wished.items():
        if is_wished and name not in TAKES[kind]:
            raise refuse(file, f"--{name}", f"not for a {kind} file", f"leave --{name} out")
    if (options.start is None) != (options.goal is None):
        raise refuse(file, "--start", "start and goal go together", "give both or neither")
    if options.start is not None and (wished["count"] or wished["window"]):
        fix = "leave them out, or leave start and goal out"
        raise refuse(file, "--start", "with --count or --window it is chosen", fix)


def _of_cells(path: Path, family: str, whole: Cells, options: ImportOptions) -> Iterator[World]:
    for index in range(options.count):
        random = _random(path, options, index)
        cells = whole if options.window is None else whole.window(random, options.window)
        cells = cells.trimmed()
        ends = None
        if options.start is not None and options.goal is not None:
            ends = cells.on_floor(options.start), cells.on_floor(options.goal)
        made = _made(path, family, options, ends, None if ends else index)
        yield grid_world(cells, made, random)


def _of_scenarios(path: Path, options: ImportOptions) -> Iterator[World]:
    """Yield worlds of some scenarios, selected by the seed, on the map beside their file."""
    scenarios = load_scenarios(path)
    if options.count > len(scenarios):
        reason = f"{options.count} asked for, {len(scenarios)} in the file"
        raise refuse(str(path), "--count", reason, "ask for fewer")
    random = _random(path, options, 0)
    for scenario in random.sample(scenarios, options.count):
        whole = load_map(_map_of(path, scenario), options.cell_m or CELL_M)
        fits(scenario, whole, str(path))
        cells = whole.trimmed()
        start, goal = (
            cells.on_floor(whole.centre(whole.rows - 1 - row, column))
            for column, row in (scenario.start, scenario.goal)
        )
        made = _made(path, "moving_ai", options, (start, goal), scenario.line)
        yield grid_world(cells, made, random)


def _map_of(path: Path, scenario: MovingAiScenario) -> Path:
    """Return the map beside the scenarios, with their name or the name they contain."""
    named = scenario.map_name.replace("\\", "/").rsplit("/", 1)[-1]
    bare = path.with_suffix("")
    for beside in (bare, bare.with_suffix(".map"), path.parent / named):
        if beside.suffix.lower() == ".map" and beside.is_file():
            return beside
    fix = f"put {named} beside it"
    raise refuse(str(path), "map", f"{named} is not beside it", fix, scenario.line)


def _of_field(
    path: Path, family: str, field: CylinderField, options: ImportOptions
) -> Iterator[World]:
    ends = field.ends
    if options.start is not None and options.goal is not None:
        left, low = field.corner
        (x0, y0), (x1, y1) = options.start, options.goal
        ends = (x0 - left, y0 - low), (x1 - left, y1 - low)
    for index in range(options.count):
        made = _made(path, family, options, ends, None if ends else index)
        yield cylinder_world(field, made, _random(path, options, index))


def _made(
    path: Path,
    family: str,
    options: ImportOptions,
    ends: tuple[Point, Point] | None,
    index: int | None,
) -> ImportedWorld:
    """Return name and origin of a world; what the seed has chosen is in the name."""
    stem = _stem(path)
    name = stem if index is None else f"{stem}_{options.seed}_{index:03d}"
    start, goal = ends or (None, None)
    return ImportedWorld(
        file=str(path),
        name=name,
        family=family,
        seed=options.seed,
        start=start,
        goal=goal,
        typed=None
        if options.start is None or options.goal is None
        else (options.start, options.goal),
    )


def _random(path: Path, options: ImportOptions, index: int) -> Draws:
    return Draws(f"{_stem(path)}/{options.seed}/{index}")


def _stem(path: Path) -> str:
    """Return a valid name of a world from the file's name without suffixes."""
    stem = path.name.removesuffix(path.suffix).removesuffix(".map")
    clean = re.sub(r"[^A-Za-z0-9._-]|^\.", "_", stem)
    return clean[:MAX_STEM_LENGTH] or "world"
