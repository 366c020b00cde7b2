"""Describe a place on the map in words, and measure between two places."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from math import atan2, degrees, hypot, inf

from ground.map.scene import MapScene, Outline, Shape
from ground.map.view import Point


def measured(start: Point, end: Point) -> str:
    """Return distance and heading from one place to another."""
    dx_m, dy_m = end[0] - start[0], end[1] - start[1]
    return f"{hypot(dx_m, dy_m):.2f} m at {degrees(atan2(dy_m, dx_m)):z.0f}°"


def described(scene: MapScene, place: Point, reach_m: float) -> str:
    """Return what is within reach of a place, and how far the robot is."""
    found = [
        *([obstacle_words(scene, place, reach_m)] if scene.obstacles else []),
        *(
            words
            for points, words in (
                (scene.seen, "echo of the last 5 s"),
                (scene.seen_late, "echo of the last 20 s"),
                (scene.seen_old, "older echo"),
                (scene.trail, "on the robot's trail"),
                (scene.hits, "hit point H"),
                (scene.leaves, "leave point L"),
            )
            if nearest_m(points, place) <= reach_m
        ),
    ]
    if scene.robot is not None:
        robot = (scene.robot.x_m, scene.robot.y_m)
        found.append(f"{measured(robot, place)} from the robot")
    return f"{place[0]:zg} {place[1]:zg}: {', '.join(found) or 'nothing known'}"


def obstacle_words(scene: MapScene, place: Point, reach_m: float) -> str:
    """Return whether a place is in an obstacle, else how far the nearest one is."""
    name = "obstacle" if scene.truth else "seen obstacle"
    if any(is_inside(shape, place) for shape in scene.obstacles[1:]):
        return f"in an {name}" if scene.truth else f"in a {name}"
    away_m = min(distance_m(shape, place) for shape in scene.obstacles)
    return f"{'at an' if away_m <= reach_m else 'nearest'} {name} {away_m:.2f} m away"


def nearest_m(points: Iterable[Point], place: Point) -> float:
    """Return the distance to the nearest point; inf without points."""
    return min((hypot(x_m - place[0], y_m - place[1]) for x_m, y_m in points), default=inf)


def distance_m(shape: Shape, place: Point) -> float:
    """Return the distance from a place to the edge of a shape."""
    if not isinstance(shape, Outline):
        return abs(hypot(shape.x_m - place[0], shape.y_m - place[1]) - shape.radius_m)
    points = shape.points_m
    ends = (*points, points[0]) if shape.closed and points else points
    return min((segment_m(start, end, place) for start, end in pairwise(ends)), default=inf)


def segment_m(start: Point, end: Point, place: Point) -> float:
    """Return the distance from a place to a segment."""
    dx_m, dy_m = end[0] - start[0], end[1] - start[1]
    px_m, py_m = place[0] - start[0], place[1] - start[1]
    length = dx_m * dx_m + dy_m * dy_m
    share = max(0.0, min(1.0, (px_m * dx_m + py_m * dy_m) / length)) if length else 0.0
    return hypot(px_m - share * dx_m, py_m - share * dy_m)


def is_inside(shape: Shape, place: Point) -> bool:
    """Return whether a place is inside a closed shape."""
    if not isinstance(shape, Outline):
        return hypot(shape.x_m - place[0], shape.y_m - place[1]) < shape.radius_m
    return shape.closed and crossings(shape.points_m, place) % 2 == 1


def crossings(points: Sequence[Point], place: Point) -> int:
    """Return how many edges a ray from a place to the right crosses."""
    x_m, y_m = place
    edges = pairwise((*points, points[0])) if points else ()
    return sum(
        (y1 > y_m) != (y2 > y_m) and x_m < x1 + (y_m - y1) * (x2 - x1) / (y2 - y1)
        for (x1, y1), (x2, y2) in edges
    )
