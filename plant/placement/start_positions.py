"""Start positions of several robots: side by side, as the obstacles allow."""

from collections.abc import Iterator
from itertools import islice
from math import cos, sin
from typing import Final

from plant.model.body import Body
from plant.model.geometry import clearance_m
from plant.model.scene import Pose
from plant.model.types import World

GAP_M: Final = 0.36
"""Wider than the avoidance zone (0.30 m), so that neighbours do not block each other."""
ROOM_M: Final = 0.02
MAX_PLACE: Final = 50


def starts(world: World, body: Body, robots: int) -> list[Pose]:
    """Return the starts: the first at the world's start, the others alternately left and right.

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
    for place in range(1, MAX_PLACE):
        for side in (place, -place):
            sideways_m = side * (2.0 * body.radius_m + GAP_M)
            x_m = start.x_m - sideways_m * sin(start.heading_rad)
            y_m = start.y_m + sideways_m * cos(start.heading_rad)
            if _free(world, x_m, y_m, body.radius_m + ROOM_M):
                yield (x_m, y_m, start.heading_rad)


def _free(world: World, x_m: float, y_m: float, needed_m: float) -> bool:
    width_m, height_m = world.size_m
    rim_m = min(x_m, y_m, width_m - x_m, height_m - y_m)
    if world.walls and rim_m < needed_m:
        return False
    return all(clearance_m((x_m, y_m), obstacle) >= needed_m for obstacle in world.obstacles)
