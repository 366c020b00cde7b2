"""Shrinking: the fewest walls and the roundest numbers that still violate the same property.

First the parameters of the family are made simple, then extras are dropped, then obstacles (by
delta debugging, Zeller and Hildebrandt 2002) and points of walls, and last every number is rounded,
the roundest first. Each step is kept if the trial still ends in the same class.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from math import degrees, radians
from typing import Final, TypeVar

from plant.corpus.draft import Axis
from plant.corpus.generate import measured
from plant.model.errors import WorldError
from plant.world.file import loads
from plant.world.writer import dumps
from protocol.world import Obstacle, Point, Polyline, World, WorldCircle, WorldPolygon
from study.falsify import climb
from study.falsify.climb import SearchCandidate, SearchSettings, Violation
from study.falsify.evaluate import evaluate
from study.falsify.properties import Evaluation, time_limit_s

GRIDS_M: Final = (0.5, 0.25, 0.1, 0.05, 0.02, 0.01)
THIN_M: Final = (0.1, 0.05, 0.02, 0.01)
TURNS_DEG: Final = (90.0, 45.0, 15.0, 5.0, 1.0)


def roundings(world: World, part: int | str) -> Iterator[World]:
    """Yield the world with one part's numbers on ever finer grids; a number is an obstacle."""
    for grid_m in GRIDS_M:
        yield _rounded(world, part, grid_m)
    if part == "start":
        for turn_deg in TURNS_DEG:
            heading_deg = degrees(world.start.heading_rad)
            rounded_rad = radians(_on(heading_deg, turn_deg))
            yield replace(world, start=replace(world.start, heading_rad=rounded_rad))
    if isinstance(part, int):
        yield from _single_numbers(world, part)


def _single_numbers(world: World, number: int) -> Iterator[World]:
    """Yield the world with a rounder thickness, and with single points of a wall rounded."""
    wall = world.obstacles[number]
    if not isinstance(wall, Polyline):
        return
    for thick_m in THIN_M:
        yield _with(world, number, Polyline(wall.points_m, thick_m))
    for place in range(len(wall.points_m)):
        for grid_m in GRIDS_M:
            points = list(wall.points_m)
            points[place] = _point(points[place], grid_m)
            yield _with(world, number, Polyline(tuple(points), wall.thickness_m))


def _rounded(world: World, part: int | str, grid_m: float) -> World:
    everything = part == "all"
    if everything or part == "size":
        world = replace(world, size_m=_point(world.size_m, grid_m))
    if everything or part == "start":
        x_m, y_m = _point((world.start.x_m, world.start.y_m), grid_m)
        world = replace(world, start=replace(world.start, x_m=x_m, y_m=y_m))
    if everything or part == "goal":
        x_m, y_m = _point((world.goal.x_m, world.goal.y_m), grid_m)
        world = replace(world, goal=replace(world.goal, x_m=x_m, y_m=y_m))
    for number, obstacle in enumerate(world.obstacles):
        if everything or part == number:
            world = _with(world, number, _obstacle(obstacle, grid_m))
    return world


def _with(world: World, number: int, obstacle: Obstacle) -> World:
    obstacles = list(world.obstacles)
    obstacles[number] = obstacle
    return replace(world, obstacles=tuple(obstacles))


def _obstacle(obstacle: Obstacle, grid_m: float) -> Obstacle:
    if isinstance(obstacle, WorldCircle):
        x_m, y_m = _point((obstacle.x_m, obstacle.y_m), grid_m)
        radius_m = max(0.01, _on(obstacle.radius_m, min(grid_m, 0.05)))
        path_m = tuple(_point(point, grid_m) for point in obstacle.path_m)
        return replace(obstacle, x_m=x_m, y_m=y_m, radius_m=radius_m, path_m=path_m)
    points_m = tuple(_point(point, grid_m) for point in obstacle.points_m)
    if isinstance(obstacle, WorldPolygon):
        return WorldPolygon(points_m)
    return Polyline(points_m, obstacle.thickness_m)


def _point(point: Point, grid_m: float) -> Point:
    return _on(point[0], grid_m), _on(point[1], grid_m)


def _on(value: float, grid: float) -> float:
    """Return the nearest multiple of a grid, without the noise of binary fractions."""
    return round(round(value / grid) * grid, 3) + 0.0


MAX_WORLDS: Final = 600
MAX_SIMULATED_S: Final = 20_000.0
"""Most worlds and most simulated time of one shrinking."""

LATER: Final = 1.5
"""A trial may end so much later than the smallest one before, unless that one ran out of time."""

LATER_S: Final = 30.0
MIN_POINTS: Final = 2
HEADINGS_DEG: Final = (0.0, 90.0, 180.0, -90.0)
SIMPLE: Final[Mapping[str, tuple[float, ...]]] = {
    "turn_deg": (0.0, 90.0, 45.0),
    "heading_deg": (0.0, 90.0, 180.0),
    "usual_robot": (1.0,),
    "people": (0.0, 1.0),
    "fault": (0.0,),
    "count": (1.0, 2.0, 3.0),
    "thickness_m": (0.02, 0.05),
    "room_m": (0.5, 1.0),
    "seed": (0.0, 1.0),
}
"""Values tried first for parameters of these names."""

One = TypeVar("One")


class Shrinker:
    """Shrink one violation; `best` is the smallest evaluation so far."""

    def __init__(
        self, settings: SearchSettings, violation: Violation, most: int = MAX_WORLDS
    ) -> None:
        self.subject, self.varied = settings.subject, settings.varied
        self.letter = violation.letter
        self.kind = violation.evaluation.kind
        self.candidate = violation.candidate
        self.best = violation.evaluation
        self.trials, self.most, self.simulated_s = 0, most, 0.0
        self._tried: set[tuple[str, int]] = set()

    def shrink(self) -> Evaluation:
        """Run all steps until none helps or the trials are used up; return the smallest."""
        self._simplify_values()
        self._drop_extras()
        before = ""
        while before != (before := dumps(self.best.world)) and not self.is_spent:
            self._drop_obstacles()
            self._drop_points()
            self._round()
        return self.best

    @property
    def is_spent(self) -> bool:
        """True when no more worlds are tried."""
        return len(self._tried) >= self.most or self.simulated_s >= MAX_SIMULATED_S

    def _limit_s(self, world: World) -> float:
        """Return the time limit of a trial: short, unless the failure is that time runs out."""
        if self.kind.startswith("timeout"):
            return time_limit_s(world)
        return min(time_limit_s(world), LATER * self.best.outcome.time_s + LATER_S)

    def accept(self, world: World, seed: int | None = None) -> bool:
        """Run a trial in a smaller world; keep it if it ends in the same class."""
        seed = self.best.seed if seed is None else seed
        text = dumps(replace(world, shortest_path_m=None, reachable=None))
        if (text, seed) in self._tried or self.is_spent:
            return False
        self._tried.add((text, seed))
        known = checked(text)
        if known is None or known.reachable != self.best.world.reachable:
            return False
        result = evaluate(self.subject, known, seed, self._limit_s(known))
        self.trials += 1
        self.simulated_s += result.outcome.time_s
        if self.letter not in result.violated or result.kind != self.kind:
            return False
        self.best = result
        return True

    def _simplify_values(self) -> None:
        """Try simple values of the parameters, one after the other."""
        for axis in climb.axes_of(self.candidate.family, self.varied):
            for value in simple_values(axis, self.candidate.values[axis.name]):
                other = SearchCandidate(
                    self.candidate.family, {**self.candidate.values, axis.name: value}
                )
                first = self.best.world
                world = climb.built(other, first.name, first.family_seed or 0)
                if world is not None and self.accept(world, round(other.values["seed"])):
                    self.candidate = other
                    break
            if self.simulated_s > MAX_SIMULATED_S / 2.0:
                return

    def _drop_extras(self) -> None:
        """Drop robot, faults, and headings that are not needed."""
        world = self.best.world
        if world.robot:
            self.accept(replace(world, robot={}))
        for name in sorted(self.best.world.robot):
            world = self.best.world
            kept = {key: value for key, value in world.robot.items() if key != name}
            self.accept(replace(world, robot=kept))
        if self.best.world.faults:
            self.accept(replace(self.best.world, faults=()))
        for heading_deg in HEADINGS_DEG:
            world = self.best.world
            if world.start.heading_rad in map(radians, HEADINGS_DEG):
                break
            self.accept(
                replace(world, start=replace(world.start, heading_rad=radians(heading_deg)))
            )

    def _drop_obstacles(self) -> None:
        """Remove obstacles by delta debugging: ever smaller parts of the list."""
        reduce_list(
            list(self.best.world.obstacles),
            lambda kept: self.accept(replace(self.best.world, obstacles=tuple(kept))),
        )

    def _drop_points(self) -> None:
        """Remove points of walls, in ever smaller parts of each."""
        for number, wall in enumerate(self.best.world.obstacles):
            if isinstance(wall, Polyline):
                reduce_list(list(wall.points_m), partial(self._accept_points, number, wall))

    def _accept_points(self, number: int, wall: Polyline, points: list[Point]) -> bool:
        """Accept a wall with fewer points."""
        if len(points) < MIN_POINTS:
            return False
        other = Polyline(tuple(points), wall.thickness_m)
        return self.accept(replaced(self.best.world, number, other))

    def _round(self) -> None:
        """Round numbers: all at once, then those of each part, coarse before fine."""
        for part in parts_of(self.best.world):
            for other in roundings(self.best.world, part):
                if other == self.best.world or self.accept(other):
                    break


def checked(text: str) -> World | None:
    """Return the world of a text with its shortest path; None if it is not valid as a file."""
    try:
        return measured(loads(text))
    except WorldError:
        return None


def simple_values(axis: Axis, value: float) -> Iterator[float]:
    """Yield values of an axis that are simpler than a value, the simplest first."""
    listed = SIMPLE.get(axis.name, ())
    if value in listed:
        yield from listed[: listed.index(value)]
        return
    rounded = [round(value, decimals) for decimals in (0, 1, 2)]
    for other in dict.fromkeys((*listed, *rounded)):
        if axis.low <= other <= axis.high and other != value:
            yield other


def parts_of(world: World) -> list[int | str]:
    """Return the parts of a world whose numbers are rounded together; numbers are obstacles."""
    return ["all", "size", "start", "goal", *range(len(world.obstacles))]


def replaced(world: World, number: int, obstacle: Obstacle) -> World:
    """Return the world with another obstacle at a place of its list."""
    obstacles = list(world.obstacles)
    obstacles[number] = obstacle
    return replace(world, obstacles=tuple(obstacles))


def reduce_list(items: list[One], still_fails: Callable[[list[One]], bool]) -> list[One]:
    """Return a part of a list that still fails, from which no item can be removed alone."""
    size = max(1, len(items) // 2)
    while items:
        place, removed = 0, False
        while place < len(items):
            kept = items[:place] + items[place + size :]
            if still_fails(kept):
                items, removed = kept, True
            else:
                place += size
        if size == 1 and not removed:
            return items
        size = max(1, size // 2)
    return items


def walls_in(world: World) -> int:
    """Return the number of straight walls, posts and people in a world."""
    count = 0
    for obstacle in world.obstacles:
        if isinstance(obstacle, Polyline):
            count += len(obstacle.points_m) - 1
        else:
            count += 1 if isinstance(obstacle, WorldCircle) else len(obstacle.points_m)
    return count


def shrunk(settings: SearchSettings, violation: Violation) -> tuple[Evaluation, int]:
    """Shrink a violation; return the smallest evaluation and the number of trials."""
    shrinker = Shrinker(settings, violation)
    return shrinker.shrink(), shrinker.trials
