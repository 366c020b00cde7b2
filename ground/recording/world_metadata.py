"""What can be drawn of a recorded world, and where."""

from collections.abc import Iterator
from itertools import pairwise
from math import atan2, hypot
from typing import Final

from ground.recording.foxglove_schemas import Colour, Json, Point, colour, disc, pose, vector
from protocol.world import Polyline, World, WorldCircle, WorldPolygon, world_in

HEIGHT_M: Final = 0.3
SKIN_M: Final = 0.02
FAINT: Final = 0.4


def world_of(text: str) -> World | None:
    """Return the world that the plant described; None when it is malformed."""
    try:
        return world_in(text)
    except ValueError:
        return None


def outlines(world: World) -> Iterator[tuple[list[Point], float]]:
    """Yield points and thickness of each wall and polygon; closed lines end where they begin."""
    if world.walls:
        wide_m, high_m = world.size_m
        corners = [(0.0, 0.0), (wide_m, 0.0), (wide_m, high_m), (0.0, high_m), (0.0, 0.0)]
        yield corners, SKIN_M
    for obstacle in world.obstacles:
        if isinstance(obstacle, WorldPolygon):
            yield [*obstacle.points_m, obstacle.points_m[0]], SKIN_M
        elif isinstance(obstacle, Polyline):
            yield list(obstacle.points_m), obstacle.thickness_m


def discs(world: World) -> list[WorldCircle]:
    """Return the discs; recordings lack the positions of moving ones."""
    return [obstacle for obstacle in world.obstacles if isinstance(obstacle, WorldCircle)]


def solids(world: World, tint: Colour) -> tuple[list[Json], list[Json]]:
    """Return cubes and cylinders of all obstacles; moving ones are pale, at their start."""
    cubes = [
        _side(a, b, thickness_m, tint)
        for points, thickness_m in outlines(world)
        for a, b in pairwise(points)
    ]
    faint = (*tint[:3], FAINT)
    cylinders = [
        disc((one.x_m, one.y_m), one.radius_m, HEIGHT_M, faint if one.path_m else tint)
        for one in discs(world)
    ]
    return cubes, cylinders


def _side(a: Point, b: Point, thickness_m: float, tint: Colour) -> Json:
    middle = ((a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0)
    length_m = hypot(b[0] - a[0], b[1] - a[1])
    turned_rad = atan2(b[1] - a[1], b[0] - a[0])
    return {
        "pose": pose(*middle, turned_rad, z_m=HEIGHT_M / 2.0),
        "size": vector(length_m, thickness_m, HEIGHT_M),
        "color": colour(tint),
    }
