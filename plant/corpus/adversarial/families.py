"""The adversarial families by name, and the world of one vector of parameters.

A robot MARGIN_M larger reaches a reachable goal, too, and one MARGIN_M smaller does not reach an
unreachable goal. No failure can then be an artefact of the computed shortest path.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import radians
from typing import Final

from plant.corpus.adversarial import enclosures, passages, scenes
from plant.corpus.adversarial.axes import Adversary, Axis, Values
from plant.model.body import Body
from plant.model.configuration import body_of
from plant.model.draws import Draws
from plant.model.errors import Report
from plant.model.geometry import distance_m
from plant.model.types import GoalPose, Settings, Start, World
from plant.placement.clear_places import Floor, check_places
from plant.placement.shortest_path import shortest_path_m

MARGIN_M: Final = 0.005

ADVERSARIES: Final[Mapping[str, Adversary]] = {
    "three_walls": scenes.THREE_WALLS,
    "wedge": scenes.WEDGE,
    "symmetric_trap": scenes.SYMMETRIC_TRAP,
    "tight_door": scenes.TIGHT_DOOR,
    "nested_rings": enclosures.NESTED_RINGS,
    "nested_boxes": enclosures.NESTED_BOXES,
    "double_spiral": enclosures.DOUBLE_SPIRAL,
    "interlocking_spirals": enclosures.INTERLOCKING_SPIRALS,
    "island_room": enclosures.ISLAND_ROOM,
    "comb": passages.COMB,
    "hairpin": passages.HAIRPIN,
    "long_detour": passages.LONG_DETOUR,
    "post_lattice": passages.POST_LATTICE,
    "long_maze": passages.LONG_MAZE,
}
ADVERSARIAL_FAMILIES: Final = tuple(ADVERSARIES)
"""Families made to fool a navigator; not part of the corpus itself."""


def drawn(random: Draws, axes: tuple[Axis, ...]) -> dict[str, float]:
    """Draw a value for each axis."""
    return {axis.name: drawn_value(random, axis) for axis in axes}


def drawn_value(random: Draws, axis: Axis) -> float:
    """Draw a value of an axis, with four decimals."""
    if axis.whole:
        return float(random.randint(int(axis.low), int(axis.high)))
    return round(random.uniform(axis.low, axis.high), 4)


def world_of(
    family: str, values: Values, name: str, seed: int, robot: Settings | None = None
) -> World | None:
    """Return the world of a vector of parameters; None if the values make no valid world.

    None, too, if the shortest path is less of a detour than the family demands.
    """
    settings = dict(robot or {})
    radius_m = float(settings.get("radius_m", Body().radius_m))
    adversary = ADVERSARIES[family]
    draft = adversary.make(values, radius_m)
    if draft is None:
        return None
    start_rad = radians(round(values.get("heading_deg", 0.0), 1))
    world = World(
        name=name,
        size_m=draft.size_m,
        start=Start(x_m=draft.start[0], y_m=draft.start[1], heading_rad=start_rad),
        goal=GoalPose(x_m=draft.goal[0], y_m=draft.goal[1], heading_tolerance_rad=radians(3.0)),
        obstacles=draft.obstacles,
        robot=settings,
        family=family,
        family_seed=seed,
    )
    found = measured(world)
    if found is None or found.shortest_path_m is None:
        return found
    return (
        found
        if found.shortest_path_m >= adversary.detour * distance_m(draft.start, draft.goal)
        else None
    )


def measured(world: World) -> World | None:
    """Return the world with its shortest path; None if larger or smaller robots fare otherwise.

    None, too, if a robot MARGIN_M larger has no room at start or goal.
    """
    radius_m = body_of(world).radius_m
    if not _has_room(world, radius_m + MARGIN_M):
        return None
    length_m = shortest_path_m(world)
    reachable = length_m is not None
    other_m = radius_m + (MARGIN_M if reachable else -MARGIN_M)
    other = replace(world, robot={**world.robot, "radius_m": other_m})
    if (shortest_path_m(other) is not None) != reachable:
        return None
    rounded_m = None if length_m is None else round(length_m, 3)
    return replace(world, shortest_path_m=rounded_m, reachable=reachable)


def _has_room(world: World, radius_m: float) -> bool:
    """Return whether a robot of this radius has room at start and goal."""
    report = Report("", {})
    floor = Floor(world.size_m, world.walls, radius_m, dict(enumerate(world.obstacles)))
    check_places(report, floor, world.start, world.goal)
    return not report.problems


def adversarial_world(random: Draws, family: str, name: str, seed: int) -> World | None:
    """Draw a world of an adversarial family; None if the values make no valid world."""
    return world_of(family, drawn(random, ADVERSARIES[family].axes), name, seed)
