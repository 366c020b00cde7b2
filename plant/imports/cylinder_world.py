"""Convert a field of cylinders to a world with start, goal and shortest path."""

from typing import Final

from plant.imports.barn import CylinderField
from plant.imports.made import ImportedWorld, bare_world, check_size, with_way
from plant.imports.places import MIN_APART_M, STANDING_M
from plant.imports.refusal import refuse
from plant.model.draws import Draws
from plant.model.geometry import clearance_m, distance_m
from plant.model.types import Point, World
from plant.placement.shortest_path import shortest_path_m

MAX_DRAWS: Final = 2000
MAX_PAIRS: Final = 30
"""Limit of the pairs searched: a path search costs more than drawing places."""


def cylinder_world(field: CylinderField, made: ImportedWorld, random: Draws) -> World:
    """Return the world; WorldError if it is too large, or no robot fits at start or goal."""
    check_size(field.size_m, made.file)
    if made.start is not None and made.goal is not None:
        world = bare_world(field.size_m, (made.start, made.goal), field.cylinders, made, random)
        return with_way(world, made, shortest_path_m(world))
    for _ in range(MAX_PAIRS):
        ends = _ends(field, random)
        if ends is not None:
            world = bare_world(field.size_m, ends, field.cylinders, made, random)
            length_m = shortest_path_m(world)
            if length_m is not None:
                return with_way(world, made, length_m)
    reason = f"no two places {STANDING_M:g} m from anything with a way between them"
    raise refuse(made.file, "start", reason, "give --start and --goal")


def _ends(field: CylinderField, random: Draws) -> tuple[Point, Point] | None:
    """Return the two most distant of a few free places."""
    free: list[Point] = []
    for _ in range(MAX_DRAWS):
        x_m, y_m = (
            round(random.uniform(STANDING_M, side - STANDING_M), 3) for side in field.size_m
        )
        if all(clearance_m((x_m, y_m), one) >= STANDING_M for one in field.cylinders):
            free.append((x_m, y_m))
        if len(free) == 4:
            break
    pairs = [(a, b) for a in free for b in free if distance_m(a, b) >= MIN_APART_M]
    return max(pairs, key=lambda pair: distance_m(*pair), default=None)
