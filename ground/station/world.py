"""Shapes of the plant's world: simulated truth, for the map only."""

from itertools import pairwise
from math import dist
from typing import NamedTuple

from ground.map.scene import Disc, MapTarget, Outline, Shape
from protocol.world import Obstacle, Point, World, WorldCircle, WorldPolygon, world_in
from runtime.errors import RemoteError


class Mover(NamedTuple):
    """A disc that moves back and forth along its waypoints."""

    radius_m: float
    speed_m_s: float
    path_m: tuple[Point, ...]

    def at(self, time_s: float) -> Disc:
        """Return its position at this simulated time."""
        lengths_m = [dist(a, b) for a, b in pairwise(self.path_m)]
        whole_m = sum(lengths_m)
        if whole_m <= 0.0:
            return Disc(*self.path_m[0], self.radius_m)
        gone_m = (time_s * self.speed_m_s) % (2.0 * whole_m)
        along_m = min(gone_m, 2.0 * whole_m - gone_m)
        for (a, b), length_m in zip(pairwise(self.path_m), lengths_m, strict=True):
            if along_m <= length_m and length_m > 0.0:
                share = along_m / length_m
                return Disc(
                    a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), self.radius_m
                )
            along_m -= length_m
        return Disc(*self.path_m[-1], self.radius_m)


class WorldFacts(NamedTuple):
    """A world in metres and radians; `text` is the plant's JSON, for trials in this world."""

    name: str
    size_m: Point
    obstacles: tuple[Shape, ...]
    movers: tuple[Mover, ...]
    start: tuple[float, float, float]
    goal: MapTarget
    radius_m: float
    text: str


def parse_world(answer: bytes | str) -> WorldFacts:
    """Parse the answer of the WORLD service; RemoteError when it is malformed."""
    text = answer.decode(errors="replace") if isinstance(answer, bytes) else answer
    try:
        return shown(world_in(text), text)
    except ValueError as error:
        raise RemoteError(f"the plant's world cannot be read: {error!r}") from error


def shown(world: World, text: str) -> WorldFacts:
    """Return the shapes of a world."""
    circles = [one for one in world.obstacles if isinstance(one, WorldCircle)]
    shapes = [
        _shape(one) for one in world.obstacles if not (isinstance(one, WorldCircle) and one.path_m)
    ]
    if world.walls:
        width_m, height_m = world.size_m
        corners = (0.0, 0.0), (width_m, 0.0), (width_m, height_m), (0.0, height_m)
        shapes.insert(0, Outline(corners))
    start, goal = world.start, world.goal
    return WorldFacts(
        name=world.name,
        size_m=world.size_m,
        obstacles=tuple(shapes),
        movers=tuple(
            Mover(one.radius_m, one.speed_m_s, one.path_m) for one in circles if one.path_m
        ),
        start=(start.x_m, start.y_m, start.heading_rad),
        goal=MapTarget(goal.x_m, goal.y_m, goal.heading_rad, goal.position_tolerance_m),
        radius_m=world.radius_m,
        text=text,
    )


def _shape(obstacle: Obstacle) -> Shape:
    if isinstance(obstacle, WorldCircle):
        return Disc(obstacle.x_m, obstacle.y_m, obstacle.radius_m)
    return Outline(obstacle.points_m, closed=isinstance(obstacle, WorldPolygon))
