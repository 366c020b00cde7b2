"""Draws worlds of a family until one is what the family promises, and says how short its way is.

Where the goal can be reached there is a way for a robot MARGIN_M larger than ours in radius, so
that no passage is tighter than anyone can drive; where it cannot, there is none for ours.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import radians
from random import Random
from typing import Final

from plant.corpus import buildings, crowds, forests, shapes, shut, traps
from plant.corpus.draft import Draft, Family, standing_room
from plant.corpus.grids import CELL_M, MAPS
from plant.imports.grid_world import grid_world
from plant.imports.made import ImportedWorld, with_way
from plant.imports.moving_ai import parse_map
from plant.model.body import Body
from plant.model.errors import WorldError
from plant.model.types import GoalPose, Start, World
from plant.placement.shortest_path import shortest_path_m

MARGIN_M: Final = 0.03
MAX_TRIES: Final = 500
SHARE_WITH_HEADING: Final = 0.5

_DRAWN: Final[Mapping[str, Family]] = {
    "open": shapes.open_floor,
    "disc": shapes.disc,
    "box": shapes.box,
    "wall": shapes.wall,
    "corner": shapes.corner,
    "corridor": traps.corridor,
    "dead_end": traps.dead_end,
    "u_trap": traps.u_trap,
    "spiral": traps.spiral,
    "zigzag": traps.zigzag,
    "door": traps.door,
    "office": buildings.office,
    "maze": buildings.maze,
    "forest_sparse": forests.sparse,
    "forest_medium": forests.medium,
    "forest_dense": forests.dense,
    "moving": crowds.moving,
    "unreachable": shut.unreachable,
}
FAMILIES: Final = tuple(_DRAWN)
GRID_FAMILIES: Final = tuple(MAPS)
"""Maps in Moving AI's style, made through its importer; no part of the corpus itself."""


def generate(family: str, index: int, seed: int) -> World:
    """The world of that number in a family; ValueError for a family that is not there."""
    if family not in (*FAMILIES, *GRID_FAMILIES):
        raise ValueError(
            f"no family {family!r}; there are {', '.join((*FAMILIES, *GRID_FAMILIES))}"
        )
    random, name = Random(f"{family}/{seed}/{index}"), f"{family}_{seed}_{index:03d}"
    for _ in range(MAX_TRIES):
        make = _map_world if family in MAPS else _drawn_world
        world = make(random, family, name, seed)
        if world is not None:
            return world
    raise RuntimeError(f"{family} {index} of seed {seed}: {MAX_TRIES} drafts, none of them sound")


def corpus(per_family: int, seed: int) -> Iterator[World]:
    """So many worlds of every family."""
    for family in FAMILIES:
        for index in range(per_family):
            yield generate(family, index, seed)


def _drawn_world(random: Random, family: str, name: str, seed: int) -> World | None:
    """None when the draft is not what its family promises."""
    draft = _DRAWN[family](random)
    if draft is None or not standing_room(draft):
        return None
    world = _world(random, draft, name)
    length_m = shortest_path_m(world)
    if (length_m is not None) != draft.reachable or not _roomy(world, draft.reachable):
        return None
    return with_way(world, ImportedWorld(file=name, name=name, family=family, seed=seed), length_m)


def _map_world(random: Random, family: str, name: str, seed: int) -> World | None:
    """None when no two places on the map have a way between them."""
    made = ImportedWorld(file=f"{name}.map", name=name, family=family, seed=seed)
    try:
        world = grid_world(parse_map(MAPS[family](random), made.file, CELL_M), made, random)
    except WorldError:
        return None
    return world if world.reachable else None


def _world(random: Random, draft: Draft, name: str) -> World:
    """With headings in tenths of a degree; to arrive any way round is asked for half the time."""
    start_deg, goal_deg = (round(random.uniform(-180.0, 180.0), 1) for _ in range(2))
    fixed = random.random() < SHARE_WITH_HEADING
    return World(
        name=name,
        size_m=draft.size_m,
        start=Start(x_m=draft.start[0], y_m=draft.start[1], heading_rad=radians(start_deg)),
        goal=GoalPose(
            x_m=draft.goal[0],
            y_m=draft.goal[1],
            heading_rad=radians(goal_deg) if fixed else None,
            heading_tolerance_rad=radians(3.0),
        ),
        obstacles=draft.obstacles,
    )


def _roomy(world: World, reachable: bool) -> bool:
    """Whether a robot a little larger finds its way too, where there is one."""
    larger = replace(world, robot={"radius_m": Body().radius_m + MARGIN_M})
    return not reachable or shortest_path_m(larger) is not None
