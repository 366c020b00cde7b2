"""Plane geometry for checking worlds, and their static parts as discs and one-sided edges."""

from collections.abc import Sequence
from itertools import pairwise
from math import inf
from typing import Final, NamedTuple, TypeAlias, TypeGuard

from protocol.world import Obstacle, Point, Polyline, World, WorldCircle, WorldPolygon
from runtime.elementary import hypot

TOUCHING_M: Final = 1e-9


def edges(points: tuple[Point, ...], closed: bool) -> list[tuple[Point, Point]]:
    """Return the edges between successive points."""
    ends = points[1:] + points[:1] if closed else points[1:]
    return list(zip(points, ends, strict=False))


def distance_m(a: Point, b: Point) -> float:
    """Return the distance of two points."""
    return hypot(b[0] - a[0], b[1] - a[1])


def length_m(points: Sequence[Point]) -> float:
    """Return the length of the straight lines from point to point."""
    total_m = 0.0
    for a, b in pairwise(points):
        total_m += distance_m(a, b)
    return total_m


def twice_area_m2(points: tuple[Point, ...]) -> float:
    """Return twice the area of a polygon, negative if its points go clockwise."""
    total_m2 = 0.0
    for a, b in edges(points, closed=True):
        total_m2 += a[0] * b[1] - b[0] * a[1]
    return total_m2


def nearest_share(point: Point, a: Point, b: Point) -> float:
    """Return the share of segment ab, from 0 to 1, at which it is nearest to a point."""
    along_x, along_y = b[0] - a[0], b[1] - a[1]
    length2 = along_x * along_x + along_y * along_y
    if length2 == 0.0:
        return 0.0
    share = ((point[0] - a[0]) * along_x + (point[1] - a[1]) * along_y) / length2
    return min(1.0, max(0.0, share))


def from_segment_m(point: Point, a: Point, b: Point) -> float:
    """Return the distance of a point from a segment; a may equal b."""
    along_x, along_y, share = b[0] - a[0], b[1] - a[1], nearest_share(point, a, b)
    return hypot(point[0] - a[0] - share * along_x, point[1] - a[1] - share * along_y)


def _side(point: Point, a: Point, b: Point) -> float:
    return (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])


def meet(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Return whether segments ab and cd cross or touch."""
    if _side(a, c, d) * _side(b, c, d) < 0.0 and _side(c, a, b) * _side(d, a, b) < 0.0:
        return True
    return between_ends_m(a, b, c, d) <= TOUCHING_M


def between_ends_m(a: Point, b: Point, c: Point, d: Point) -> float:
    """Return the smallest distance of an end of one of segments ab and cd from the other."""
    return min(
        from_segment_m(a, c, d),
        from_segment_m(b, c, d),
        from_segment_m(c, a, b),
        from_segment_m(d, a, b),
    )


def area_m2(points: tuple[Point, ...]) -> float:
    """Return the area of a polygon."""
    return abs(twice_area_m2(points)) / 2.0


def inside(point: Point, points: tuple[Point, ...]) -> bool:
    """Return whether the polygon contains the point (even-odd rule)."""
    odd = False
    for a, b in edges(points, closed=True):
        if (a[1] > point[1]) != (b[1] > point[1]):
            crossing_x = a[0] + (point[1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1])
            odd ^= point[0] < crossing_x
    return odd


def clearance_m(point: Point, obstacle: Obstacle) -> float:
    """Return the distance from a point to an obstacle's surface, 0 or less inside it.

    A moving circle is taken at its start.
    """
    if isinstance(obstacle, WorldCircle):
        return hypot(point[0] - obstacle.x_m, point[1] - obstacle.y_m) - obstacle.radius_m
    solid = isinstance(obstacle, WorldPolygon)
    if solid and inside(point, obstacle.points_m):
        return 0.0
    nearest_m = min(
        (from_segment_m(point, a, b) for a, b in edges(obstacle.points_m, closed=solid)),
        default=inf,
    )
    return (
        nearest_m if isinstance(obstacle, WorldPolygon) else nearest_m - obstacle.thickness_m / 2.0
    )


def crossing_edges(points: tuple[Point, ...]) -> tuple[int, int] | None:
    """Return the indices of the first two edges of a polygon that meet without being neighbours."""
    sides = edges(points, closed=True)
    count = len(sides)
    for i in range(count):
        for j in range(i + 2, count):
            if (j + 1) % count != i and meet(*sides[i], *sides[j]):
                return i, j
    return None


def folded_corner(points: tuple[Point, ...]) -> int | None:
    """Return the index of the first corner at which an edge runs back on the one before it."""
    count = len(points)
    for i in range(count):
        before, here, after = points[i - 1], points[i], points[(i + 1) % count]
        if (
            from_segment_m(after, before, here) <= TOUCHING_M
            or from_segment_m(before, here, after) <= TOUCHING_M
        ):
            return i
    return None


Pose: TypeAlias = tuple[float, float, float]
"""x_m, y_m, heading_rad."""

Disc: TypeAlias = tuple[float, float, float]
"""x_m, y_m, radius_m."""

Edge: TypeAlias = tuple[float, float, float, float]
"""From x_m, y_m to x_m, y_m; the solid is on the left, so it is visible only from the right."""


class StaticScene(NamedTuple):
    """Discs and edges of a world."""

    discs: tuple[Disc, ...]
    edges: tuple[Edge, ...]


def still(world: World) -> StaticScene:
    """Return everything of the world that does not move."""
    discs: list[Disc] = []
    edges: list[Edge] = list(_outer_walls(world)) if world.walls else []
    for obstacle in world.obstacles:
        if isinstance(obstacle, WorldPolygon):
            edges += _outline(obstacle.points_m)
        elif isinstance(obstacle, Polyline):
            radius_m = obstacle.thickness_m / 2.0
            discs += [(x_m, y_m, radius_m) for x_m, y_m in obstacle.points_m]
            for a, b in pairwise(obstacle.points_m):
                edges += _flanks(a, b, radius_m)
        elif not moves(obstacle):
            discs.append((obstacle.x_m, obstacle.y_m, obstacle.radius_m))
    return StaticScene(tuple(discs), tuple(edges))


def moves(obstacle: Obstacle) -> TypeGuard[WorldCircle]:
    """Return whether an obstacle moves."""
    return (
        isinstance(obstacle, WorldCircle)
        and obstacle.speed_m_s > 0.0
        and len(set(obstacle.path_m)) > 1
    )


def movers(world: World) -> tuple[WorldCircle, ...]:
    """Return the moving obstacles of a world."""
    return tuple(obstacle for obstacle in world.obstacles if moves(obstacle))


def _outer_walls(world: World) -> list[Edge]:
    """Return the rim of the floor, clockwise: the solid is outside."""
    width_m, height_m = world.size_m
    corners = ((0.0, 0.0), (0.0, height_m), (width_m, height_m), (width_m, 0.0))
    return [(*a, *b) for a, b in edges(corners, closed=True)]


def _outline(points: tuple[Point, ...]) -> list[Edge]:
    """Return the edges of a polygon, counter-clockwise."""
    turned = points if twice_area_m2(points) > 0.0 else points[::-1]
    return [(*a, *b) for a, b in edges(turned, closed=True)]


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
