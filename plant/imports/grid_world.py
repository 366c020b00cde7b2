"""Convert blocked and free cells to a world with obstacles, start, goal and shortest path."""

from plant.imports.cells import Cells
from plant.imports.made import ImportedWorld, bare_world, check_size, with_way
from plant.imports.outlines import outlines
from plant.imports.places import STANDING_M, far_apart
from plant.imports.refusal import refuse
from plant.imports.routes import Places, route_m
from plant.model.body import Body
from plant.model.draws import Draws
from plant.model.types import Point, World


def grid_world(cells: Cells, made: ImportedWorld, random: Draws) -> World:
    """Return the world; WorldError if it is too large, or no robot fits at start or goal."""
    check_size(cells.size_m, made.file)
    ends = _ends(cells, made, random)
    world = bare_world(cells.size_m, ends, outlines(cells), made, random)
    radius_m = Body().radius_m
    return with_way(world, made, route_m(world, Places(cells, radius_m), radius_m))


def _ends(cells: Cells, made: ImportedWorld, random: Draws) -> tuple[Point, Point]:
    if made.start is not None and made.goal is not None:
        return made.start, made.goal
    found = far_apart(cells, random, Body().radius_m)
    if found is None:
        reason = f"no two places {STANDING_M:g} m from anything with a way between them"
        raise refuse(made.file, "start", reason, "make the cells larger with --cell, or the window")
    return found
