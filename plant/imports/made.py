"""Last step of every import: a checked world with its shortest path."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians
from typing import Final

from plant.imports.refusal import refuse
from plant.model.body import Body
from plant.model.draws import Draws
from plant.model.errors import Report, WorldError
from plant.model.types import GoalPose, Obstacle, Point, Start, World
from plant.placement.clear_places import Floor, check_places
from plant.world.reader import MAX_OBSTACLES, SIZE

HEADING_TOLERANCE_RAD: Final = radians(3.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedWorld:
    """Name and origin of a world; `file` is its name in errors.

    `start` and `goal` are on our floor, with its lower left corner at (0, 0); None: to be selected.
    """

    file: str
    name: str
    family: str
    seed: int
    start: Point | None = None
    goal: Point | None = None


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
    report = Report(made.file, {})
    floor = Floor(size_m, True, Body().radius_m, dict(enumerate(obstacles)))
    check_places(report, floor, start, goal)
    if report.problems:
        raise WorldError([problem._replace(line=None) for problem in report.problems])
    return World(name=made.name, size_m=size_m, start=start, goal=goal, obstacles=tuple(obstacles))


def with_way(world: World, made: ImportedWorld, length_m: float | None) -> World:
    """Return the world with its shortest path, or with an unreachable goal."""
    return replace(
        world,
        family=made.family,
        family_seed=made.seed,
        shortest_path_m=None if length_m is None else round(length_m, 3),
        reachable=length_m is not None,
    )
