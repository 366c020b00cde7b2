"""Collisions of robots with walls, moving obstacles and each other.

Robots are discs that keep their given speed until something stops them, without bouncing and
friction. Where a robot may touch something, a step is divided into small ones, so that it
penetrates by less than a millimetre and never passes through.

Contacts are solved by sequential impulses, the method of Chipmunk and Box2D. It is written out
here, in operations that are rounded in the same way on every machine, because a trajectory depends
on it to the last bit; a compiled library depends on its compiler and on the processor.

pymunk only answers one question: which surfaces are near a place? No number that it computes enters
a trajectory, so the bits of a trajectory do not depend on its version. No other module uses pymunk.
Between nearby positions most surfaces can neither become the nearest one nor be touched. The
candidates are therefore cached while the robot stays near the position of the last search.

Moving obstacles go back and forth along their waypoints, at constant speed, unstoppable.
"""

from collections.abc import Iterator, Sequence
from itertools import accumulate, pairwise
from math import ceil, floor, inf, sqrt
from typing import Final, NamedTuple, TypeAlias

import pymunk

from plant.model.geometry import distance_m, edges, movers, moves
from protocol.world import Point, Polyline, World, WorldCircle, WorldPolygon
from runtime.elementary import hypot

ITERATIONS: Final = 10
SLOP_M: Final = 1e-4
"""A contact keeps this overlap, so that it lasts."""


class ContactDisc:
    """A robot or a moving obstacle: position, velocity, and the velocity that undoes an overlap.

    Only a `free` one is moved by contacts.
    """

    __slots__ = ("free", "push_x_m_s", "push_y_m_s", "radius_m", "x_m", "x_m_s", "y_m", "y_m_s")

    def __init__(self, x_m: float, y_m: float, radius_m: float, *, free: bool) -> None:
        self.x_m, self.y_m, self.radius_m, self.free = x_m, y_m, radius_m, free
        self.x_m_s = self.y_m_s = self.push_x_m_s = self.push_y_m_s = 0.0

    def move(self, span_s: float) -> None:
        """Move for a time; an overlap is undone once."""
        self.x_m += (self.x_m_s + self.push_x_m_s) * span_s
        self.y_m += (self.y_m_s + self.push_y_m_s) * span_s
        self.push_x_m_s = self.push_y_m_s = 0.0


class DiscContact:
    """An overlap of a robot and another disc; x, y is the unit vector from the robot to it."""

    __slots__ = ("_apart_m_s", "_impulse", "_push", "_share", "other", "robot", "x", "y")

    def __init__(
        self,
        robot: ContactDisc,
        other: ContactDisc,
        direction: tuple[float, float],
        apart_m_s: float,
    ) -> None:
        """Create a contact; `apart_m_s` is the speed that undoes the overlap in one step."""
        self.robot, self.other = robot, other
        self.x, self.y = direction
        self._apart_m_s = apart_m_s
        self._share = 0.5 if other.free else 1.0
        self._impulse = self._push = 0.0

    def solve(self) -> None:
        """Change both velocities so that the discs come no nearer and lose their overlap."""
        robot, other, x, y = self.robot, self.other, self.x, self.y
        closing_m_s = (robot.push_x_m_s - other.push_x_m_s) * x
        closing_m_s += (robot.push_y_m_s - other.push_y_m_s) * y
        push = max(0.0, self._push + (self._apart_m_s + closing_m_s) * self._share)
        change, self._push = push - self._push, push
        robot.push_x_m_s -= change * x
        robot.push_y_m_s -= change * y
        if other.free:
            other.push_x_m_s += change * x
            other.push_y_m_s += change * y
        closing_m_s = (robot.x_m_s - other.x_m_s) * x + (robot.y_m_s - other.y_m_s) * y
        impulse = max(0.0, self._impulse + closing_m_s * self._share)
        change, self._impulse = impulse - self._impulse, impulse
        robot.x_m_s -= change * x
        robot.y_m_s -= change * y
        if other.free:
            other.x_m_s += change * x
            other.y_m_s += change * y


def solve(contacts: Sequence[DiscContact]) -> None:
    """Solve all contacts of a step together."""
    for _ in range(ITERATIONS):
        for contact in contacts:
            contact.solve()


NEAR_M: Final = 0.15
"""Radius around the position of a search in which its result is valid."""

FURTHER_M: Final = 2.0 * NEAR_M
"""Surfaces farther than the nearest one by more than this stay farther within NEAR_M."""


class Surface(NamedTuple):
    """The points at a distance from a line, which starts at x_m, y_m; a disc has no line.

    `per_m2` is the inverse of the line's squared length, 0 without a line.
    """

    x_m: float
    y_m: float
    along_x_m: float
    along_y_m: float
    per_m2: float
    radius_m: float

    def offset_m(self, x_m: float, y_m: float) -> Point:
        """Return the vector from a point to the nearest point of the line."""
        start_x_m, start_y_m, along_x_m, along_y_m, per_m2, _ = self
        off_x_m, off_y_m = start_x_m - x_m, start_y_m - y_m
        share = -(off_x_m * along_x_m + off_y_m * along_y_m) * per_m2
        if share > 1.0:
            share = 1.0
        elif not share > 0.0:
            share = 0.0
        return off_x_m + share * along_x_m, off_y_m + share * along_y_m


def line(a: Point, b: Point, radius_m: float) -> Surface:
    """Return the surface around the line from a to b, which may be equal."""
    along_x_m, along_y_m = b[0] - a[0], b[1] - a[1]
    square_m2 = along_x_m * along_x_m + along_y_m * along_y_m
    return Surface(*a, along_x_m, along_y_m, 1.0 / square_m2 if square_m2 else 0.0, radius_m)


class Nearby:
    """The candidates for the nearest surface near a position, and the distance to them."""

    __slots__ = ("_at", "surfaces")

    def __init__(self) -> None:
        self._at = (inf, inf)
        self.surfaces: Sequence[Surface] = ()

    def holds(self, at: Point) -> bool:
        """Return whether the cache is valid for a position."""
        off_x_m, off_y_m = at[0] - self._at[0], at[1] - self._at[1]
        return off_x_m * off_x_m + off_y_m * off_y_m <= NEAR_M * NEAR_M

    def remember(self, at: Point, surfaces: Sequence[Surface]) -> None:
        """Store the surfaces that are at most FURTHER_M farther away than the nearest one."""
        self._at, self.surfaces = at, surfaces

    def distance_m(self, at: Point) -> float:
        """Return the distance from a nearby point, below 0 inside; inf without a surface."""
        x_m, y_m = at
        nearest_m = inf
        for start_x_m, start_y_m, along_x_m, along_y_m, per_m2, radius_m in self.surfaces:
            off_x_m, off_y_m = start_x_m - x_m, start_y_m - y_m
            if per_m2 != 0.0:  # as `Surface.offset_m`, without a call
                share = -(off_x_m * along_x_m + off_y_m * along_y_m) * per_m2
                if share > 0.0:
                    share = share if share < 1.0 else 1.0
                    off_x_m, off_y_m = off_x_m + share * along_x_m, off_y_m + share * along_y_m
            away_m = sqrt(off_x_m * off_x_m + off_y_m * off_y_m) - radius_m
            if away_m < nearest_m:
                nearest_m = away_m
        return nearest_m


CLEARANCE_LIMIT_M: Final = 3.0
"""Largest clearance that is measured."""

FINE_STEP_M: Final = 0.001
OUTER_WALL_M: Final = 0.5

Pair: TypeAlias = tuple[ContactDisc, ContactDisc, Surface | None]
"""A robot and what it may touch: another disc, or a surface, whose disc has no place."""


class Arena:
    """A world with its robots and moving obstacles, by index."""

    def __init__(
        self,
        world: World,
        radius_m: float,
        at: Sequence[Point] | None = None,
        sight_m: float = CLEARANCE_LIMIT_M,
    ) -> None:
        """Create the world; `at` are the movers' positions, by default the start of their paths.

        `sight_m` is the distance between two rims up to which robots are neighbours.
        """
        self._radius_m = radius_m
        self._sight_m = max(CLEARANCE_LIMIT_M, sight_m)
        self._robots: list[ContactDisc] = []
        self._neighbours: list[list[int]] = []
        self._nearby: list[Nearby] = []
        self._still = ContactDisc(0.0, 0.0, 0.0, free=False)
        self._touching: list[DiscContact] = []
        discs = movers(world)
        places = [circle.path_m[0] for circle in discs] if at is None else at
        self._movers = [
            ContactDisc(*place, circle.radius_m, free=False)
            for circle, place in zip(discs, places, strict=True)
        ]
        self._surfaces = list(_still_surfaces(world))
        self._space = pymunk.Space()
        self._index = {
            _shape(self._space.static_body, surface): number
            for number, surface in enumerate(self._surfaces)
        }
        self._space.add(*self._index)

    def add_robot(self, x_m: float, y_m: float) -> int:
        """Add a robot and return its index."""
        self._robots.append(ContactDisc(x_m, y_m, self._radius_m, free=True))
        self._nearby.append(Nearby())
        number = len(self._robots) - 1
        self._neighbours = [[*others, number] for others in self._neighbours]
        self._neighbours.append(list(range(number)))
        return number

    def look_around(self, way_m: float) -> None:
        """Find the neighbours of each robot anew, for as long as none moves by more than a way."""
        cell_m = self._sight_m + 2.0 * (self._radius_m + way_m)
        cells: dict[tuple[int, int], list[int]] = {}
        homes = [(floor(one.x_m / cell_m), floor(one.y_m / cell_m)) for one in self._robots]
        for number, home in enumerate(homes):
            cells.setdefault(home, []).append(number)
        around = {
            (column, row): sorted(
                number
                for x in (column - 1, column, column + 1)
                for y in (row - 1, row, row + 1)
                for number in cells.get((x, y), ())
            )
            for column, row in cells
        }
        self._neighbours = [
            self._within(number, around[home], cell_m) for number, home in enumerate(homes)
        ]

    def _within(self, number: int, others: Sequence[int], reach_m: float) -> list[int]:
        robots = self._robots
        x_m, y_m = robots[number].x_m, robots[number].y_m
        return [
            other
            for other in others
            if -reach_m <= robots[other].x_m - x_m <= reach_m
            and -reach_m <= robots[other].y_m - y_m <= reach_m
            and other != number
        ]

    def neighbours(self, robot: int) -> list[int]:
        """Return the other robots that may be in sight of a robot, in ascending order."""
        return self._neighbours[robot]

    def push(self, robot: int, x_m_s: float, y_m_s: float) -> None:
        """Set the velocity of a robot, which it keeps unless an obstacle stops it."""
        disc = self._robots[robot]
        disc.x_m_s, disc.y_m_s = x_m_s, y_m_s

    def carry(self, mover: int, at: Point, x_m_s: float, y_m_s: float) -> None:
        """Set position and velocity of a moving obstacle; nothing stops it."""
        disc = self._movers[mover]
        disc.x_m, disc.y_m = at
        disc.x_m_s, disc.y_m_s = x_m_s, y_m_s

    def step(self, span_s: float, closing_m_s: float) -> None:
        """Advance time; `closing_m_s` is the largest possible collision speed, 0 if none."""
        discs = [*self._robots, *self._movers]
        parts = max(1, ceil(closing_m_s * span_s / FINE_STEP_M))
        part_s = span_s / parts
        pairs = list(self._pairs(2.0 * closing_m_s * span_s)) if closing_m_s else []
        for _ in range(parts):
            for disc in discs:
                disc.move(part_s)
            self._touching = list(_overlaps(pairs, part_s)) if pairs else []
            if self._touching:
                solve(self._touching)

    def position_m(self, robot: int) -> Point:
        """Return the position of a robot."""
        disc = self._robots[robot]
        return disc.x_m, disc.y_m

    def places_m(self) -> list[Point]:
        """Return the positions of all robots."""
        return [(disc.x_m, disc.y_m) for disc in self._robots]

    def place(self, robot: int, x_m: float, y_m: float) -> None:
        """Set the position of a robot that moved without the arena."""
        disc = self._robots[robot]
        disc.x_m, disc.y_m = x_m, y_m

    def clearance_m(self, robot: int, at: Point) -> float:
        """Return the distance from the robot's rim to the nearest surface, below 0 in contact."""
        distance_m = self._around(robot, at).distance_m(at)
        for disc in self._movers + self._beside(robot):
            off_x_m = disc.x_m - at[0]
            if abs(off_x_m) - disc.radius_m < distance_m:
                away_m = hypot(off_x_m, disc.y_m - at[1]) - disc.radius_m
                distance_m = min(distance_m, away_m)
        limit_m = CLEARANCE_LIMIT_M + self._radius_m
        return distance_m - self._radius_m if distance_m < limit_m else CLEARANCE_LIMIT_M

    def contacts(self, robot: int) -> list[tuple[Point, bool]]:
        """Return the contacts of a robot: unit vector of the direction, and static or not."""
        mine = self._robots[robot]
        found = [
            ((one.x, one.y), one.other is self._still)
            for one in self._touching
            if one.robot is mine
        ]
        return found + [((-one.x, -one.y), False) for one in self._touching if one.other is mine]

    def _pairs(self, way_m: float) -> Iterator[Pair]:
        """Return what the robots may touch while they come nearer by a distance."""
        for number, robot in enumerate(self._robots):
            at, reach_m = (robot.x_m, robot.y_m), robot.radius_m + way_m + FINE_STEP_M
            for other in (*self._movers, *self._beside(number, after=number)):
                if hypot(other.x_m - at[0], other.y_m - at[1]) - other.radius_m < reach_m:
                    yield robot, other, None
        # Static surfaces come last: what is solved last is kept, if not everything can be.
        for number, robot in enumerate(self._robots):
            at, reach_m = (robot.x_m, robot.y_m), robot.radius_m + way_m + FINE_STEP_M
            for surface in self._around(number, at).surfaces:
                if hypot(*surface.offset_m(*at)) - surface.radius_m < reach_m:
                    yield robot, self._still, surface

    def _beside(self, robot: int, after: int = -1) -> list[ContactDisc]:
        """Return the neighbours of a robot whose number is greater than `after`."""
        near = self._neighbours[robot]
        return [self._robots[other] for other in near if other > after] if near else []

    def _around(self, robot: int, at: Point) -> Nearby:
        """Return the static surfaces that can be nearest to a robot, or touched, near a place."""
        nearby = self._nearby[robot]
        if not nearby.holds(at):
            farthest_m = CLEARANCE_LIMIT_M + self._radius_m + NEAR_M
            nearest = self._space.point_query_nearest(at, farthest_m, pymunk.ShapeFilter())
            reach_m = -inf if nearest is None else nearest.distance + FURTHER_M
            found = self._space.point_query(at, max(0.0, reach_m), pymunk.ShapeFilter())
            numbers = sorted(self._index[one.shape] for one in found if one.shape is not None)
            nearby.remember(at, [self._surfaces[number] for number in numbers])
        return nearby


def _overlaps(pairs: Sequence[Pair], span_s: float) -> Iterator[DiscContact]:
    for robot, other, surface in pairs:
        if surface is None:
            off_x_m, off_y_m = other.x_m - robot.x_m, other.y_m - robot.y_m
            touching_m = robot.radius_m + other.radius_m
        else:
            off_x_m, off_y_m = surface.offset_m(robot.x_m, robot.y_m)
            touching_m = robot.radius_m + surface.radius_m
        away_m = sqrt(off_x_m * off_x_m + off_y_m * off_y_m)
        if 0.0 < away_m < touching_m:
            direction = off_x_m / away_m, off_y_m / away_m
            apart_m_s = max(0.0, touching_m - away_m - SLOP_M) / span_s
            yield DiscContact(robot, other, direction, apart_m_s)


def _shape(body: pymunk.Body, surface: Surface) -> pymunk.Shape:
    x_m, y_m, along_x_m, along_y_m, per_m2, radius_m = surface
    if per_m2 == 0.0:
        return pymunk.Circle(body, radius_m, (x_m, y_m))
    return pymunk.Segment(body, (x_m, y_m), (x_m + along_x_m, y_m + along_y_m), radius_m)


def _still_surfaces(world: World) -> Iterator[Surface]:
    if world.walls:
        yield from _outer_walls(world)
    for obstacle in world.obstacles:
        if isinstance(obstacle, WorldPolygon):
            for a, b in edges(obstacle.points_m, closed=True):
                yield line(a, b, 0.0)
        elif isinstance(obstacle, Polyline):
            for a, b in pairwise(obstacle.points_m):
                yield line(a, b, obstacle.thickness_m / 2.0)
        elif not moves(obstacle):
            at = (obstacle.x_m, obstacle.y_m)
            yield line(at, at, obstacle.radius_m)


def _outer_walls(world: World) -> list[Surface]:
    """Return thick bars whose inner faces are the rim of the floor."""
    out = OUTER_WALL_M
    right, top = world.size_m[0] + out, world.size_m[1] + out
    corners: tuple[Point, ...] = ((-out, -out), (right, -out), (right, top), (-out, top))
    return [line(a, b, out) for a, b in edges(corners, closed=True)]


class MovingDisc:
    """One moving disc; its position is a closed function of time."""

    def __init__(self, circle: WorldCircle) -> None:
        self.radius_m = circle.radius_m
        self.speed_m_s = circle.speed_m_s
        self._legs = list(pairwise(circle.path_m))
        self._lengths_m = [distance_m(a, b) for a, b in self._legs]
        self._ends_m = list(accumulate(self._lengths_m))

    def position_m(self, time_s: float) -> Point:
        """Return the position at a time."""
        whole_m = self._ends_m[-1]
        gone_m = (time_s * self.speed_m_s) % (2.0 * whole_m)
        along_m = gone_m if gone_m <= whole_m else 2.0 * whole_m - gone_m
        leg = next((i for i, end_m in enumerate(self._ends_m) if along_m <= end_m), -1)
        (ax, ay), (bx, by) = self._legs[leg]
        if self._lengths_m[leg] == 0.0:
            return bx, by
        share = 1.0 - (self._ends_m[leg] - along_m) / self._lengths_m[leg]
        return ax + share * (bx - ax), ay + share * (by - ay)
