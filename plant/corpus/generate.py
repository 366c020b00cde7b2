"""Generate the worlds of a family: draw until a draft has the guaranteed properties.

If the goal is reachable, a robot with a radius larger by MARGIN_M can reach it, too, so no passage
is extremely tight. If the goal is unreachable, it is so for the normal robot.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from math import radians
from typing import Final, TypeAlias

from plant.corpus import buildings, crowds, forests, shapes, shut, thin, traps
from plant.corpus.adversarial.families import ADVERSARIAL_FAMILIES, adversarial_world
from plant.corpus.draft import Draft, Family, standing_room
from plant.corpus.grids import CELL_M, MAPS
from plant.imports.grid_world import grid_world
from plant.imports.made import ImportedWorld, with_way
from plant.imports.moving_ai import parse_map
from plant.model.body import Body
from plant.model.draws import Draws
from plant.model.errors import WorldError
from plant.model.types import GoalPose, Start, World
from plant.placement.shortest_path import shortest_path_m

Maker: TypeAlias = Callable[[Draws, str, str, int], World | None]
"""Draws the world of a family with a name and a seed; None if the attempt failed."""

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
    "thin": thin.thin,
    "forest_sparse": forests.sparse,
    "forest_medium": forests.medium,
    "forest_dense": forests.dense,
    "moving": crowds.moving,
    "unreachable": shut.unreachable,
}
FAMILIES: Final = tuple(_DRAWN)
GRID_FAMILIES: Final = tuple(MAPS)
"""Maps in Moving AI's style, made by its importer; not part of the corpus itself."""
_CROWDS: Final[Mapping[str, Family]] = {
    "crowd": crowds.crowd,
    "crowd_hasty": crowds.hasty_crowd,
}
CROWD_FAMILIES: Final = tuple(_CROWDS)
"""Crowds in which not every contact can be avoided; the corpus has only avoidable ones."""

EVERY_FAMILY: Final = (*FAMILIES, *GRID_FAMILIES, *CROWD_FAMILIES, *ADVERSARIAL_FAMILIES)
"""All that `generate` accepts."""


def generate(family: str, index: int, seed: int) -> World:
    """Return a world by its number in a family; raise ValueError for an unknown family."""
    if family not in EVERY_FAMILY:
        raise ValueError(f"no family {family!r}; there are {', '.join(EVERY_FAMILY)}")
    random, name = Draws(f"{family}/{seed}/{index}"), f"{family}_{seed}_{index:03d}"
    for _ in range(MAX_TRIES):
        world = _maker(family)(random, family, name, seed)
        if world is not None:
            return world
    raise RuntimeError(f"{family} {index} of seed {seed}: {MAX_TRIES} drafts, none of them valid")


def corpus(per_family: int, seed: int) -> Iterator[World]:
    """Yield a number of worlds of every family."""
    for family in FAMILIES:
        for index in range(per_family):
            yield generate(family, index, seed)


def _maker(family: str) -> Maker:
    if family in ADVERSARIAL_FAMILIES:
        return adversarial_world
    return _map_world if family in MAPS else _drawn_world


def _drawn_world(random: Draws, family: str, name: str, seed: int) -> World | None:
    """Return a world; None if the draft lacks the guaranteed property."""
    draft = (_CROWDS[family] if family in _CROWDS else _DRAWN[family])(random)
    if draft is None or not standing_room(draft):
        return None
    world = _world(random, draft, name)
    length_m = shortest_path_m(world)
    if (length_m is not None) != draft.reachable or not _roomy(world, draft.reachable):
        return None
    return with_way(world, ImportedWorld(file=name, name=name, family=family, seed=seed), length_m)


def _map_world(random: Draws, family: str, name: str, seed: int) -> World | None:
    """Return a world from a map; None if no two of its places are connected."""
    made = ImportedWorld(file=f"{name}.map", name=name, family=family, seed=seed)
    try:
        world = grid_world(parse_map(MAPS[family](random), made.file, CELL_M), made, random)
    except WorldError:
        return None
    return world if world.reachable else None


def _world(random: Draws, draft: Draft, name: str) -> World:
    """Return the world of a draft.

    Headings are in tenths of a degree; half of the goals have a free heading.
    """
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
    """Return whether a slightly larger robot reaches the goal, too, if it is reachable."""
    larger = replace(world, robot={"radius_m": Body().radius_m + MARGIN_M})
    return not reachable or shortest_path_m(larger) is not None
