"""Start positions of several robots: side by side, then in ranks behind and ahead of the first."""

from collections.abc import Iterator
from itertools import islice
from typing import Final

from plant.model.body import Body
from plant.model.geometry import clearance_m
from plant.model.scene import Pose
from plant.model.types import World
from runtime.elementary import cos, sin

GAP_M: Final = 0.36
"""Wider than the avoidance zone (0.30 m), so that neighbours do not block each other."""
ROOM_M: Final = 0.02
MAX_PLACE: Final = 50
RANKS: Final = (0, -1, 1, -2, 2, -3, 3)
"""Ranks are filled in this order; a negative one is behind the start of the world."""


def starts(world: World, body: Body, robots: int) -> list[Pose]:
    """Return the starts: the first at the world's start, the others alternately left and right.

    When their rank is full, further robots start in other ranks, behind it and ahead of it.

    Raises ValueError if there are fewer free places than robots.
    """
    if robots < 1:
        raise ValueError(f"robots: {robots} is less than one")
    found = list(islice(_free_places(world, body), robots))
    if len(found) < robots:
        raise ValueError(
            f"robots: {world.name} has room for {len(found)} beside its start, not for {robots}"
        )
    return found


def _free_places(world: World, body: Body) -> Iterator[Pose]:
    start = world.start
    yield (start.x_m, start.y_m, start.heading_rad)
    for rank, place in ((rank, place) for rank in RANKS for place in _from_the_middle()):
        if (rank, place) == (0, 0):
            continue
        ahead_m, left_m = (number * (2.0 * body.radius_m + GAP_M) for number in (rank, place))
        along, across = cos(start.heading_rad), sin(start.heading_rad)
        x_m = start.x_m + ahead_m * along - left_m * across
        y_m = start.y_m + ahead_m * across + left_m * along
        if _free(world, x_m, y_m, body.radius_m + ROOM_M):
            yield (x_m, y_m, start.heading_rad)


def _from_the_middle() -> Iterator[int]:
    """Yield the places of a rank: 0, then alternately left (positive) and right."""
    yield 0
    for place in range(1, MAX_PLACE):
        yield from (place, -place)


def _free(world: World, x_m: float, y_m: float, needed_m: float) -> bool:
    width_m, height_m = world.size_m
    rim_m = min(x_m, y_m, width_m - x_m, height_m - y_m)
    if world.walls and rim_m < needed_m:
        return False
    return all(clearance_m((x_m, y_m), obstacle) >= needed_m for obstacle in world.obstacles)
