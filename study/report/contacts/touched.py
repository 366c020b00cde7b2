"""The touched obstacle, the place on its surface, and whether that is an edge."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from math import hypot
from typing import Final, NamedTuple

from plant.model.geometry import clearance_m, distance_m, nearest_share
from plant.model.types import Circle, Obstacle, Point, Polygon, Polyline, World
from plant.sim.physics import Mover
from study.report.contacts.recorder import MM_PER_M

EDGE_M: Final = 0.03
"""A place this near to the end of a wall or to a corner counts as that edge."""

BLOCK: Final = "block"


class Touched(NamedTuple):
    """The touched place, with a short name of its obstacle.

    `mover` is set if the place belongs to a person or another moving disc.
    """

    name: str
    point: Point
    is_edge: bool
    mover: Circle | None = None

    def at(self, time_s: float, seen_from: Point) -> Point:
        """Return the place at a time: of a mover, the one of its surface that is the nearest."""
        if self.mover is None:
            return self.point
        return nearest_of(_placed(self.mover, time_s), seen_from)


def world_at(world: World, time_s: float) -> World:
    """Return the world with its moving obstacles at their places of that time."""
    obstacles = tuple(
        _placed(one, time_s) if isinstance(one, Circle) and one.path_m else one
        for one in world.obstacles
    )
    return replace(world, obstacles=obstacles)


def _placed(circle: Circle, time_s: float) -> Circle:
    x_m, y_m = Mover(circle).position_m(time_s)
    return replace(circle, x_m=x_m, y_m=y_m)


def touched(world: World, robot: Point, time_s: float) -> Touched:
    """Return the obstacle nearest to the robot at a time, and its nearest place."""
    found = [
        (distance_m(robot, one.point), index, one) for index, one in _places(world, robot, time_s)
    ]
    return min(found, key=lambda one: one[:2])[2]


def _places(world: World, robot: Point, time_s: float) -> Iterator[tuple[int, Touched]]:
    now = world_at(world, time_s)
    for index, (obstacle, usual) in enumerate(zip(now.obstacles, world.obstacles, strict=True)):
        point = nearest_of(obstacle, robot)
        mover = usual if isinstance(usual, Circle) and usual.path_m else None
        others = [one for one in now.obstacles if one is not obstacle]
        edge = any(distance_m(point, one) <= EDGE_M for one in edges_of(obstacle, others))
        yield index, Touched(name_of(usual), point, edge, mover)
    if world.walls:
        (x_m, y_m), (width_m, height_m) = robot, world.size_m
        for point in ((0.0, y_m), (width_m, y_m), (x_m, 0.0), (x_m, height_m)):
            yield len(world.obstacles), Touched("outer wall", point, False)


def name_of(obstacle: Obstacle) -> str:
    """Return a short name of an obstacle."""
    if isinstance(obstacle, Polyline):
        return f"wall of {MM_PER_M * obstacle.thickness_m:g} mm"
    if isinstance(obstacle, Polygon):
        return BLOCK
    return "person" if obstacle.path_m else "disc"


def nearest_of(obstacle: Obstacle, seen_from: Point) -> Point:
    """Return the nearest point of an obstacle's surface."""
    if isinstance(obstacle, Circle):
        return _towards((obstacle.x_m, obstacle.y_m), seen_from, obstacle.radius_m)
    points = obstacle.points_m
    if isinstance(obstacle, Polygon):
        points = (*points, points[0])
    sides = [_on_segment(seen_from, a, b) for a, b in pairwise(points)]
    best = min(sides, key=lambda point: distance_m(point, seen_from))
    half_m = obstacle.thickness_m / 2.0 if isinstance(obstacle, Polyline) else 0.0
    return _towards(best, seen_from, half_m)


def edges_of(obstacle: Obstacle, others: list[Obstacle]) -> list[Point]:
    """Return the free ends of a wall, which touch no other obstacle, or the corners of a block."""
    if isinstance(obstacle, Polygon):
        return list(obstacle.points_m)
    if isinstance(obstacle, Circle):
        return []
    ends = (obstacle.points_m[0], obstacle.points_m[-1])
    return [end for end in ends if all(clearance_m(end, one) > EDGE_M for one in others)]


def _on_segment(point: Point, a: Point, b: Point) -> Point:
    share = nearest_share(point, a, b)
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


def _towards(start: Point, end: Point, way_m: float) -> Point:
    dx, dy = end[0] - start[0], end[1] - start[1]
    length_m = hypot(dx, dy)
    if length_m == 0.0:
        return start
    return start[0] + way_m * dx / length_m, start[1] + way_m * dy / length_m
