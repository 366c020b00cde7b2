"""Static parts of a world as discs and one-sided edges that a ray can hit."""

from itertools import pairwise
from typing import NamedTuple, TypeAlias, TypeGuard

from plant.model.geometry import edges as sides
from plant.model.geometry import twice_area_m2
from plant.model.types import Circle, Obstacle, Point, Polygon, Polyline, World
from runtime.elementary import hypot

Pose: TypeAlias = tuple[float, float, float]
"""x_m, y_m, heading_rad."""

Disc: TypeAlias = tuple[float, float, float]
"""x_m, y_m, radius_m."""

Edge: TypeAlias = tuple[float, float, float, float]
"""From x_m, y_m to x_m, y_m; the solid is on the left, so it is visible only from the right."""


class Scene(NamedTuple):
    """Discs and edges of a world."""

    discs: tuple[Disc, ...]
    edges: tuple[Edge, ...]


def still(world: World) -> Scene:
    """Return everything of the world that does not move."""
    discs: list[Disc] = []
    edges: list[Edge] = list(_outer_walls(world)) if world.walls else []
    for obstacle in world.obstacles:
        if isinstance(obstacle, Polygon):
            edges += _outline(obstacle.points_m)
        elif isinstance(obstacle, Polyline):
            radius_m = obstacle.thickness_m / 2.0
            discs += [(x_m, y_m, radius_m) for x_m, y_m in obstacle.points_m]
            for a, b in pairwise(obstacle.points_m):
                edges += _flanks(a, b, radius_m)
        elif not moves(obstacle):
            discs.append((obstacle.x_m, obstacle.y_m, obstacle.radius_m))
    return Scene(tuple(discs), tuple(edges))


def moves(obstacle: Obstacle) -> TypeGuard[Circle]:
    """Return whether an obstacle moves."""
    return (
        isinstance(obstacle, Circle) and obstacle.speed_m_s > 0.0 and len(set(obstacle.path_m)) > 1
    )


def movers(world: World) -> tuple[Circle, ...]:
    """Return the moving obstacles of a world."""
    return tuple(obstacle for obstacle in world.obstacles if moves(obstacle))


def _outer_walls(world: World) -> list[Edge]:
    """Return the rim of the floor, clockwise: the solid is outside."""
    width_m, height_m = world.size_m
    corners = ((0.0, 0.0), (0.0, height_m), (width_m, height_m), (width_m, 0.0))
    return [(*a, *b) for a, b in sides(corners, closed=True)]


def _outline(points: tuple[Point, ...]) -> list[Edge]:
    """Return the edges of a polygon, counter-clockwise."""
    turned = points if twice_area_m2(points) > 0.0 else points[::-1]
    return [(*a, *b) for a, b in sides(turned, closed=True)]


def _flanks(a: Point, b: Point, radius_m: float) -> list[Edge]:
    """Return the two straight sides of a capsule around ab."""
    length_m = hypot(b[0] - a[0], b[1] - a[1])
    if length_m == 0.0:
        return []
    out_x, out_y = radius_m * (b[1] - a[1]) / length_m, radius_m * (a[0] - b[0]) / length_m
    return [
        (a[0] + out_x, a[1] + out_y, b[0] + out_x, b[1] + out_y),
        (b[0] - out_x, b[1] - out_y, a[0] - out_x, a[1] - out_y),
    ]
