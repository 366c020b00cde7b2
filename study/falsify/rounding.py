"""Worlds with rounder numbers, the roundest first."""

from collections.abc import Iterator
from dataclasses import replace
from math import degrees, radians
from typing import Final

from plant.model.types import Circle, Obstacle, Point, Polygon, Polyline, World

GRIDS_M: Final = (0.5, 0.25, 0.1, 0.05, 0.02, 0.01)
THIN_M: Final = (0.1, 0.05, 0.02, 0.01)
TURNS_DEG: Final = (90.0, 45.0, 15.0, 5.0, 1.0)


def roundings(world: World, part: int | str) -> Iterator[World]:
    """Yield the world with one part's numbers on ever finer grids; a number is an obstacle."""
    for grid_m in GRIDS_M:
        yield _rounded(world, part, grid_m)
    if part == "start":
        for turn_deg in TURNS_DEG:
            heading_deg = degrees(world.start.heading_rad)
            rounded_rad = radians(_on(heading_deg, turn_deg))
            yield replace(world, start=replace(world.start, heading_rad=rounded_rad))
    if isinstance(part, int):
        yield from _single_numbers(world, part)


def _single_numbers(world: World, number: int) -> Iterator[World]:
    """Yield the world with a rounder thickness, and with single points of a wall rounded."""
    wall = world.obstacles[number]
    if not isinstance(wall, Polyline):
        return
    for thick_m in THIN_M:
        yield _with(world, number, Polyline(wall.points_m, thick_m))
    for place in range(len(wall.points_m)):
        for grid_m in GRIDS_M:
            points = list(wall.points_m)
            points[place] = _point(points[place], grid_m)
            yield _with(world, number, Polyline(tuple(points), wall.thickness_m))


def _rounded(world: World, part: int | str, grid_m: float) -> World:
    everything = part == "all"
    if everything or part == "size":
        world = replace(world, size_m=_point(world.size_m, grid_m))
    if everything or part == "start":
        x_m, y_m = _point((world.start.x_m, world.start.y_m), grid_m)
        world = replace(world, start=replace(world.start, x_m=x_m, y_m=y_m))
    if everything or part == "goal":
        x_m, y_m = _point((world.goal.x_m, world.goal.y_m), grid_m)
        world = replace(world, goal=replace(world.goal, x_m=x_m, y_m=y_m))
    for number, obstacle in enumerate(world.obstacles):
        if everything or part == number:
            world = _with(world, number, _obstacle(obstacle, grid_m))
    return world


def _with(world: World, number: int, obstacle: Obstacle) -> World:
    obstacles = list(world.obstacles)
    obstacles[number] = obstacle
    return replace(world, obstacles=tuple(obstacles))


def _obstacle(obstacle: Obstacle, grid_m: float) -> Obstacle:
    if isinstance(obstacle, Circle):
        x_m, y_m = _point((obstacle.x_m, obstacle.y_m), grid_m)
        radius_m = max(0.01, _on(obstacle.radius_m, min(grid_m, 0.05)))
        path_m = tuple(_point(point, grid_m) for point in obstacle.path_m)
        return replace(obstacle, x_m=x_m, y_m=y_m, radius_m=radius_m, path_m=path_m)
    points_m = tuple(_point(point, grid_m) for point in obstacle.points_m)
    if isinstance(obstacle, Polygon):
        return Polygon(points_m)
    return Polyline(points_m, obstacle.thickness_m)


def _point(point: Point, grid_m: float) -> Point:
    return _on(point[0], grid_m), _on(point[1], grid_m)


def _on(value: float, grid: float) -> float:
    """Return the nearest multiple of a grid, without the noise of binary fractions."""
    return round(round(value / grid) * grid, 3) + 0.0
