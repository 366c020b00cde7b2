"""Building blocks of families: a floor with start and goal, frames for shapes, parameters."""

from collections.abc import Callable, Iterable, Mapping
from itertools import groupby
from math import pi, radians
from typing import Final, NamedTuple, TypeAlias

from plant.model.draws import Draws
from plant.model.geometry import clearance_m, distance_m
from plant.placement import STANDING_M
from protocol.world import Obstacle, Point, Polyline, WorldCircle, WorldPolygon
from runtime.elementary import atan2, cos, sin

MIN_FLOOR_M: Final = 5.0
MAX_FLOOR_M: Final = 10.0
RIM_M: Final = 0.4

MIN_THICKNESS_M: Final = 0.02
MAX_THICKNESS_M: Final = 0.10


class WorldDraft(NamedTuple):
    """A world before its check; `reachable` is the property its family guarantees."""

    size_m: Point
    start: Point
    goal: Point
    obstacles: tuple[Obstacle, ...] = ()
    reachable: bool = True


Family: TypeAlias = Callable[[Draws], WorldDraft | None]
"""Draws a world from a stream of random numbers; None if the attempt failed."""


class ShapeFrame(NamedTuple):
    """A rotated frame on the floor; with `hand` -1 left and right are swapped."""

    origin: Point
    angle_rad: float
    hand: int = 1

    def point(self, along_m: float, left_m: float) -> Point:
        """Return a point on the floor, rounded to millimetres."""
        c, s, left_m = cos(self.angle_rad), sin(self.angle_rad), self.hand * left_m
        x_m = self.origin[0] + c * along_m - s * left_m
        y_m = self.origin[1] + s * along_m + c * left_m
        return round(x_m, 3), round(y_m, 3)

    def points(self, *local: Point) -> tuple[Point, ...]:
        """Return points on the floor."""
        return tuple(self.point(*one) for one in local)

    def box(self, x0_m: float, y0_m: float, x1_m: float, y1_m: float) -> WorldPolygon:
        """Return a box."""
        return WorldPolygon(self.points((x0_m, y0_m), (x1_m, y0_m), (x1_m, y1_m), (x0_m, y1_m)))

    def wall(self, thickness_m: float, *local: Point) -> Polyline:
        """Return a wall."""
        return Polyline(self.points(*local), thickness_m)

    def disc(self, along_m: float, left_m: float, radius_m: float) -> WorldCircle:
        """Return a disc."""
        x_m, y_m = self.point(along_m, left_m)
        return WorldCircle(x_m=x_m, y_m=y_m, radius_m=round(radius_m, 3))


class DraftFloor(NamedTuple):
    """A floor with start and goal."""

    size_m: Point
    start: Point
    goal: Point

    @property
    def length_m(self) -> float:
        """The distance from start to goal."""
        return distance_m(self.start, self.goal)

    def frame(self, share: float, left_m: float = 0.0, turn_rad: float = 0.0) -> ShapeFrame:
        """Return a frame at a share of the line to the goal, rotated from that direction."""
        (x0, y0), (x1, y1) = self.start, self.goal
        bearing_rad = atan2(y1 - y0, x1 - x0)
        way = ShapeFrame((x0 + share * (x1 - x0), y0 + share * (y1 - y0)), bearing_rad)
        return ShapeFrame(way.point(0.0, left_m), bearing_rad + turn_rad)

    def draft(self, *obstacles: Obstacle) -> WorldDraft:
        """Return the draft with these obstacles."""
        return WorldDraft(self.size_m, self.start, self.goal, obstacles)


def stage(random: Draws, apart_m: float = 3.0) -> DraftFloor:
    """Draw a floor of 5 to 10 m a side, with start and goal at least `apart_m` apart."""
    size_m = floor(random)
    while True:
        start, goal = spot(random, size_m), spot(random, size_m)
        if distance_m(start, goal) >= apart_m:
            return DraftFloor(size_m, start, goal)


def floor(random: Draws) -> Point:
    """Draw the size of a floor."""
    width_m, height_m = (random.uniform(MIN_FLOOR_M, MAX_FLOOR_M) for _ in range(2))
    return round(width_m, 2), round(height_m, 2)


def spot(random: Draws, size_m: Point, rim_m: float = RIM_M) -> Point:
    """Draw a point on the floor."""
    x_m, y_m = (random.uniform(rim_m, side_m - rim_m) for side_m in size_m)
    return round(x_m, 3), round(y_m, 3)


def tilt(random: Draws, most_deg: float) -> float:
    """Draw an angle of at most `most_deg`."""
    return radians(random.uniform(-most_deg, most_deg))


def any_angle(random: Draws) -> float:
    """Draw any angle."""
    return random.uniform(-pi, pi)


def hand(random: Draws) -> int:
    """Draw a side: 1 or -1."""
    return random.choice((-1, 1))


def thickness(random: Draws) -> float:
    """Draw the thickness of a wall."""
    return round(random.uniform(MIN_THICKNESS_M, MAX_THICKNESS_M), 3)


def on_floor(point: Point, size_m: Point, rim_m: float) -> bool:
    """Return whether a point is on the floor, clear of its rim."""
    return all(
        rim_m <= value_m <= side_m - rim_m for value_m, side_m in zip(point, size_m, strict=True)
    )


def standing_room(draft: WorldDraft) -> bool:
    """Return whether start and goal are clear of everything static; families place movers."""
    return all(
        on_floor(point, draft.size_m, STANDING_M)
        and all(clearance_m(point, obstacle) >= STANDING_M for obstacle in draft.obstacles)
        for point in (draft.start, draft.goal)
    )


MIN_ROOM_M: Final = 0.15
"""Smallest distance of a wall from the rim of the floor, so that a robot may pass or may not."""

MAX_ADVERSARIAL_FLOOR_M: Final = 25.0


class Axis(NamedTuple):
    """One parameter: its name, its range, and whether it is a whole number."""

    name: str
    low: float
    high: float
    whole: bool = False


Values: TypeAlias = Mapping[str, float]
"""One value for each axis of a family, by name."""

Maker: TypeAlias = Callable[[Values, float], WorldDraft | None]
"""Makes a draft from values and the robot's radius in metres; None if the values make no world."""


class Adversary(NamedTuple):
    """A family: its parameters, and the function that makes a draft of them.

    Passages are given as what they are wider than the robot, so that one vector of parameters fits
    every robot. `detour` is the least length of the shortest path, as a multiple of the straight
    line from start to goal.
    """

    axes: tuple[Axis, ...]
    make: Maker
    detour: float = 0.0


EXCESS: Final = Axis("excess_m", 0.02, 0.40)
"""How much wider than the robot a passage is."""

THICKNESS: Final = Axis("thickness_m", 0.005, 0.10)
TURN: Final = Axis("turn_deg", -180.0, 180.0)
HEADING: Final = Axis("heading_deg", -180.0, 180.0)
ROOM: Final = Axis("room_m", 0.3, 2.0)
"""Free space between the walls and the rim of the floor."""


def frame_of(values: Values) -> ShapeFrame:
    """Return the frame of the walls, turned about the origin."""
    return ShapeFrame((0.0, 0.0), radians(values.get("turn_deg", 0.0)))


def whole(values: Values, name: str) -> int:
    """Return a value as the nearest whole number."""
    return round(values[name])


def fitted(
    values: Values, start: Point, goal: Point, obstacles: Iterable[Obstacle], radius_m: float
) -> WorldDraft | None:
    """Return a draft whose floor fits obstacles and ends with a room around them.

    None if the floor would be too large.
    """
    walls = tuple(obstacles)
    points = [start, goal, *(point for wall in walls for point in _extent(wall))]
    room_m = max(values.get("room_m", 0.5), MIN_ROOM_M)
    low = [min(point[axis] for point in points) - room_m for axis in (0, 1)]
    high = [max(point[axis] for point in points) + room_m for axis in (0, 1)]
    # Both ends need a place for the robot, however small the room is.
    for axis in (0, 1):
        low[axis] = min(low[axis], start[axis] - 2 * radius_m, goal[axis] - 2 * radius_m)
        high[axis] = max(high[axis], start[axis] + 2 * radius_m, goal[axis] + 2 * radius_m)
    size_m = round(high[0] - low[0], 2), round(high[1] - low[1], 2)
    if max(size_m) > MAX_ADVERSARIAL_FLOOR_M:
        return None
    shift = (-low[0], -low[1])
    moved = tuple(shifted(wall, shift) for wall in walls)
    return WorldDraft(size_m, _moved(start, shift), _moved(goal, shift), moved)


def shifted(obstacle: Obstacle, by: Point) -> Obstacle:
    """Return an obstacle at another place; coordinates are whole millimetres.

    A point that falls on the one before it is dropped, as after a cut just beside a corner.
    """
    if isinstance(obstacle, WorldCircle):
        x_m, y_m = _moved((obstacle.x_m, obstacle.y_m), by)
        path_m = tuple(_moved(point, by) for point in obstacle.path_m)
        return WorldCircle(
            x_m=x_m,
            y_m=y_m,
            radius_m=obstacle.radius_m,
            path_m=path_m,
            speed_m_s=obstacle.speed_m_s,
        )
    points_m = tuple(point for point, _ in groupby(_moved(one, by) for one in obstacle.points_m))
    if isinstance(obstacle, WorldPolygon):
        return WorldPolygon(points_m)
    return Polyline(points_m, obstacle.thickness_m)


def _moved(point: Point, by: Point) -> Point:
    return round(point[0] + by[0], 3), round(point[1] + by[1], 3)


def _extent(obstacle: Obstacle) -> list[Point]:
    """Return points whose bounding box contains the obstacle, up to the thickness of a wall."""
    if isinstance(obstacle, WorldCircle):
        x_m, y_m, r_m = obstacle.x_m, obstacle.y_m, obstacle.radius_m
        return [(x_m - r_m, y_m - r_m), (x_m + r_m, y_m + r_m)]
    return list(obstacle.points_m)
