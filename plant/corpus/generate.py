"""Generate the worlds of a family: draw until a draft has the guaranteed properties.

If the goal is reachable, a robot with a radius larger by MARGIN_M can reach it, too, so no passage
is extremely tight. If the goal is unreachable, it is so for the normal robot.

An adversarial world is made of one vector of parameters. A robot ADVERSARIAL_MARGIN_M larger
reaches a reachable goal, too, and one as much smaller does not reach an unreachable goal. No
failure can then be an artefact of the computed shortest path.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from math import radians
from typing import Final, TypeAlias

from plant.corpus import adversarial, buildings, shapes, traps
from plant.corpus.buildings import MAPS
from plant.corpus.draft import Adversary, Axis, Family, Values, WorldDraft, standing_room
from plant.imports.importer import CELL_M, ImportedWorld, grid_world, with_way
from plant.imports.moving_ai import parse_map
from plant.model.configuration import Body, body_of
from plant.model.draws import Draws
from plant.model.errors import WorldError, WorldReport
from plant.model.geometry import distance_m
from plant.placement import ObstacleFloor, check_places
from plant.shortest_path import shortest_path_m
from protocol.world import GoalPose, Settings, Start, World

ADVERSARIAL_MARGIN_M: Final = 0.005

ADVERSARIES: Final[Mapping[str, Adversary]] = {
    "three_walls": adversarial.THREE_WALLS,
    "wedge": adversarial.WEDGE,
    "symmetric_trap": adversarial.SYMMETRIC_TRAP,
    "tight_door": adversarial.TIGHT_DOOR,
    "nested_rings": adversarial.NESTED_RINGS,
    "nested_boxes": adversarial.NESTED_BOXES,
    "double_spiral": adversarial.DOUBLE_SPIRAL,
    "interlocking_spirals": adversarial.INTERLOCKING_SPIRALS,
    "island_room": adversarial.ISLAND_ROOM,
    "comb": adversarial.COMB,
    "hairpin": adversarial.HAIRPIN,
    "long_detour": adversarial.LONG_DETOUR,
    "post_lattice": adversarial.POST_LATTICE,
    "long_maze": adversarial.LONG_MAZE,
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
    if not _has_room(world, radius_m + ADVERSARIAL_MARGIN_M):
        return None
    length_m = shortest_path_m(world)
    reachable = length_m is not None
    other_m = radius_m + (ADVERSARIAL_MARGIN_M if reachable else -ADVERSARIAL_MARGIN_M)
    other = replace(world, robot={**world.robot, "radius_m": other_m})
    if (shortest_path_m(other) is not None) != reachable:
        return None
    rounded_m = None if length_m is None else round(length_m, 3)
    return replace(world, shortest_path_m=rounded_m, reachable=reachable)


def _has_room(world: World, radius_m: float) -> bool:
    """Return whether a robot of this radius has room at start and goal."""
    report = WorldReport("", {})
    floor = ObstacleFloor(world.size_m, world.walls, radius_m, dict(enumerate(world.obstacles)))
    check_places(report, floor, world.start, world.goal)
    return not report.problems


def adversarial_world(random: Draws, family: str, name: str, seed: int) -> World | None:
    """Draw a world of an adversarial family; None if the values make no valid world."""
    return world_of(family, drawn(random, ADVERSARIES[family].axes), name, seed)


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
    "thin": traps.thin,
    "forest_sparse": shapes.sparse,
    "forest_medium": shapes.medium,
    "forest_dense": shapes.dense,
    "moving": shapes.moving,
    "unreachable": traps.unreachable,
}
FAMILIES: Final = tuple(_DRAWN)
GRID_FAMILIES: Final = tuple(MAPS)
"""Maps in Moving AI's style, made by its importer; not part of the corpus itself."""
_CROWDS: Final[Mapping[str, Family]] = {
    "crowd": shapes.crowd,
    "crowd_hasty": shapes.hasty_crowd,
}
CROWD_FAMILIES: Final = tuple(_CROWDS)
"""Crowds in which not every contact can be avoided; the corpus has only avoidable ones."""

FLEET_FAMILIES: Final = ("warehouse",)
"""Worlds for many robots, which start side by side; not part of the corpus itself."""

EVERY_FAMILY: Final = (
    *FAMILIES,
    *GRID_FAMILIES,
    *CROWD_FAMILIES,
    *ADVERSARIAL_FAMILIES,
    *FLEET_FAMILIES,
)
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
    if family in FLEET_FAMILIES:
        return _fleet_world
    return _map_world if family in MAPS else _drawn_world


def _fleet_world(random: Draws, family: str, name: str, seed: int) -> World | None:
    """Return a world in which robots start towards the goal, which has no heading."""
    draft = buildings.warehouse(random)
    world = World(
        name=name,
        size_m=draft.size_m,
        start=Start(x_m=draft.start[0], y_m=draft.start[1], gap_m=buildings.FLEET_GAP_M),
        goal=GoalPose(x_m=draft.goal[0], y_m=draft.goal[1]),
        obstacles=draft.obstacles,
    )
    made = ImportedWorld(file=name, name=name, family=family, seed=seed)
    return with_way(world, made, shortest_path_m(world))


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


def _world(random: Draws, draft: WorldDraft, name: str) -> World:
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
