"""Collisions in the world. This is the only module that uses pymunk.

Robots are discs that keep their given speed until something stops them, without bouncing and
friction. Where a robot may touch something, a step is divided into small ones, so that it
penetrates by less than a millimetre and never passes through.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import ceil, inf
from typing import Final

import pymunk

from plant.model.geometry import edges
from plant.model.scene import movers, moves
from plant.model.types import Circle, Point, Polygon, Polyline, World
from plant.sim.clearance import FURTHER_M, NEAR_M, Bar, Nearby, Round

CLEARANCE_LIMIT_M: Final = 3.0
"""Largest clearance that is measured."""

FINE_STEP_M: Final = 0.001
OUTER_WALL_M: Final = 0.5
SLOP_M: Final = 1e-4


class Arena:
    """A world with its robots and moving obstacles, by index."""

    def __init__(self, world: World, radius_m: float, at: Sequence[Point] | None = None) -> None:
        """Create the world; `at` are the movers' positions, by default the start of their paths."""
        self._space = pymunk.Space()
        self._space.collision_slop = SLOP_M
        self._space.collision_bias = 0.0
        self._radius_m = radius_m
        self._nearby = Nearby()
        self._robots: list[pymunk.Body] = []
        self._filters: list[pymunk.ShapeFilter] = []
        self._space.add(*_still_shapes(world, self._space.static_body))
        discs = movers(world)
        places = [circle.path_m[0] for circle in discs] if at is None else at
        self._movers = [
            self._add_mover(circle, place) for circle, place in zip(discs, places, strict=True)
        ]

    def add_robot(self, x_m: float, y_m: float) -> int:
        """Add a robot and return its index."""
        body = pymunk.Body(1.0, 1.0)
        body.position = x_m, y_m
        shape = pymunk.Circle(body, self._radius_m)
        shape.filter = pymunk.ShapeFilter(group=len(self._robots) + 1)
        self._space.add(body, shape)
        self._robots.append(body)
        self._filters.append(shape.filter)
        return len(self._robots) - 1

    def push(self, robot: int, x_m_s: float, y_m_s: float) -> None:
        """Set the velocity of a robot, which it keeps unless an obstacle stops it."""
        self._robots[robot].velocity = x_m_s, y_m_s

    def carry(self, mover: int, x_m_s: float, y_m_s: float) -> None:
        """Set the velocity of a moving obstacle; nothing stops it."""
        self._movers[mover].velocity = x_m_s, y_m_s

    def step(self, span_s: float, closing_m_s: float) -> None:
        """Advance time; `closing_m_s` is the largest possible collision speed, 0 if none."""
        parts = max(1, ceil(closing_m_s * span_s / FINE_STEP_M))
        for _ in range(parts):
            self._space.step(span_s / parts)

    def position_m(self, robot: int) -> Point:
        """Return the position of a robot."""
        position = self._robots[robot].position
        return position.x, position.y

    def place(self, robot: int, x_m: float, y_m: float) -> None:
        """Set the position of a robot that moved without the arena."""
        self._robots[robot].position = x_m, y_m

    def clearance_m(self, robot: int, at: Point) -> float:
        """Return the distance from the robot's rim to the nearest surface, below 0 in contact."""
        limit_m = CLEARANCE_LIMIT_M + self._radius_m
        if self._movers or len(self._robots) > 1:
            nearest = self._space.point_query_nearest(at, limit_m, self._filters[robot])
            distance_m = inf if nearest is None else nearest.distance
        else:
            if not self._nearby.holds(at):
                self._look_around(at)
            distance_m = self._nearby.distance_m(at)
        return distance_m - self._radius_m if distance_m < limit_m else CLEARANCE_LIMIT_M

    def contacts(self, robot: int) -> list[tuple[Point, bool]]:
        """Return the contacts of a robot: unit vector of the direction, and static or not."""
        found: list[tuple[Point, bool]] = []
        still = self._space.static_body

        def collect(arbiter: pymunk.Arbiter) -> None:
            normal = arbiter.normal
            found.append(((normal.x, normal.y), arbiter.shapes[1].body is still))

        self._robots[robot].each_arbiter(collect)
        return found

    def _look_around(self, at: Point) -> None:
        """Cache the surfaces that can be nearest to the only robot near this position."""
        space, others = self._space, self._filters[0]
        farthest_m = CLEARANCE_LIMIT_M + self._radius_m + NEAR_M
        nearest = space.point_query_nearest(at, farthest_m, others)
        rounds: list[Round] = []
        bars: list[Bar] = []
        if nearest is not None:
            for found in space.point_query(at, nearest.distance + FURTHER_M, others):
                shape = found.shape
                if isinstance(shape, pymunk.Circle):
                    rounds.append((*shape.offset, shape.radius))
                elif isinstance(shape, pymunk.Segment) and shape.a == shape.b:
                    rounds.append((*shape.a, shape.radius))
                elif isinstance(shape, pymunk.Segment):
                    bars.append((*shape.a, *shape.b, shape.radius))
        self._nearby.remember(at, rounds, bars)

    def _add_mover(self, circle: Circle, place: Point) -> pymunk.Body:
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        body.position = place
        self._space.add(body, pymunk.Circle(body, circle.radius_m))
        return body


def _still_shapes(world: World, body: pymunk.Body) -> Sequence[pymunk.Shape]:
    shapes: list[pymunk.Shape] = _outer_walls(world, body) if world.walls else []
    for obstacle in world.obstacles:
        if isinstance(obstacle, Polygon):
            sides = edges(obstacle.points_m, closed=True)
            shapes += [pymunk.Segment(body, a, b, 0.0) for a, b in sides]
        elif isinstance(obstacle, Polyline):
            radius_m = obstacle.thickness_m / 2.0
            shapes += [pymunk.Segment(body, a, b, radius_m) for a, b in pairwise(obstacle.points_m)]
        elif not moves(obstacle):
            shapes.append(pymunk.Circle(body, obstacle.radius_m, (obstacle.x_m, obstacle.y_m)))
    return shapes


def _outer_walls(world: World, body: pymunk.Body) -> list[pymunk.Shape]:
    """Return thick bars whose inner faces are the rim of the floor."""
    out = OUTER_WALL_M
    right, top = world.size_m[0] + out, world.size_m[1] + out
    corners = ((-out, -out), (right, -out), (right, top), (-out, top))
    return [pymunk.Segment(body, a, b, out) for a, b in edges(corners, closed=True)]
