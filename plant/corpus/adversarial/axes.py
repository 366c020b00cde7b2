"""The parameters of an adversarial family, and the floor that fits its walls."""

from collections.abc import Callable, Iterable, Mapping
from itertools import groupby
from math import radians
from typing import Final, NamedTuple, TypeAlias

from plant.corpus.draft import Draft, Frame
from plant.model.types import Circle, Obstacle, Point, Polygon, Polyline

RIM_M: Final = 0.15
"""Smallest distance of a wall from the rim of the floor, so that a robot may pass or may not."""

MAX_FLOOR_M: Final = 25.0


class Axis(NamedTuple):
    """One parameter: its name, its range, and whether it is a whole number."""

    name: str
    low: float
    high: float
    whole: bool = False


Values: TypeAlias = Mapping[str, float]
"""One value for each axis of a family, by name."""

Maker: TypeAlias = Callable[[Values, float], Draft | None]
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


def frame_of(values: Values) -> Frame:
    """Return the frame of the walls, turned about the origin."""
    return Frame((0.0, 0.0), radians(values.get("turn_deg", 0.0)))


def whole(values: Values, name: str) -> int:
    """Return a value as the nearest whole number."""
    return round(values[name])


def fitted(
    values: Values, start: Point, goal: Point, obstacles: Iterable[Obstacle], radius_m: float
) -> Draft | None:
    """Return a draft whose floor fits obstacles and ends with a room around them.

    None if the floor would be too large.
    """
    walls = tuple(obstacles)
    points = [start, goal, *(point for wall in walls for point in _extent(wall))]
    room_m = max(values.get("room_m", 0.5), RIM_M)
    low = [min(point[axis] for point in points) - room_m for axis in (0, 1)]
    high = [max(point[axis] for point in points) + room_m for axis in (0, 1)]
    # Both ends need a place for the robot, however small the room is.
    for axis in (0, 1):
        low[axis] = min(low[axis], start[axis] - 2 * radius_m, goal[axis] - 2 * radius_m)
        high[axis] = max(high[axis], start[axis] + 2 * radius_m, goal[axis] + 2 * radius_m)
    size_m = round(high[0] - low[0], 2), round(high[1] - low[1], 2)
    if max(size_m) > MAX_FLOOR_M:
        return None
    shift = (-low[0], -low[1])
    moved = tuple(shifted(wall, shift) for wall in walls)
    return Draft(size_m, _moved(start, shift), _moved(goal, shift), moved)


def shifted(obstacle: Obstacle, by: Point) -> Obstacle:
    """Return an obstacle at another place; coordinates are whole millimetres.

    A point that falls on the one before it is dropped, as after a cut just beside a corner.
    """
    if isinstance(obstacle, Circle):
        x_m, y_m = _moved((obstacle.x_m, obstacle.y_m), by)
        path_m = tuple(_moved(point, by) for point in obstacle.path_m)
        return Circle(
            x_m=x_m,
            y_m=y_m,
            radius_m=obstacle.radius_m,
            path_m=path_m,
            speed_m_s=obstacle.speed_m_s,
        )
    points_m = tuple(point for point, _ in groupby(_moved(one, by) for one in obstacle.points_m))
    if isinstance(obstacle, Polygon):
        return Polygon(points_m)
    return Polyline(points_m, obstacle.thickness_m)


def _moved(point: Point, by: Point) -> Point:
    return round(point[0] + by[0], 3), round(point[1] + by[1], 3)


def _extent(obstacle: Obstacle) -> list[Point]:
    """Return points whose bounding box contains the obstacle, up to the thickness of a wall."""
    if isinstance(obstacle, Circle):
        x_m, y_m, r_m = obstacle.x_m, obstacle.y_m, obstacle.radius_m
        return [(x_m - r_m, y_m - r_m), (x_m + r_m, y_m + r_m)]
    return list(obstacle.points_m)
