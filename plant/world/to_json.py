"""Convert a world to one JSON object with the keys and units of its file."""

from collections.abc import Iterable
from math import degrees
from typing import TypeAlias

from plant.model.scene import Pose
from plant.model.types import Circle, Obstacle, Polygon, Setting, Settings, World
from plant.placement.fleet_goals import RobotGoal

Json: TypeAlias = str | bool | int | float | list["Json"] | dict[str, "Json"] | None


def as_json(world: World, shortest_path_m: float | None) -> dict[str, Json]:
    """Return the JSON of a world with its shortest path; angles in degrees, heading null: any."""
    start, goal = world.start, world.goal
    return {
        "name": world.name,
        "size_m": list(world.size_m),
        "walls": world.walls,
        "start": {"x_m": start.x_m, "y_m": start.y_m, "heading_deg": _deg(start.heading_rad)},
        "goal": {
            "x_m": goal.x_m,
            "y_m": goal.y_m,
            "heading_deg": None if goal.heading_rad is None else _deg(goal.heading_rad),
            "position_tolerance_m": goal.position_tolerance_m,
            "heading_tolerance_deg": _deg(goal.heading_tolerance_rad),
        },
        "obstacles": [_obstacle(obstacle) for obstacle in world.obstacles],
        "robot": _settings(world.robot),
        "noise": _settings(world.noise),
        "faults": [_settings(fault) for fault in world.faults],
        "shortest_path_m": None if shortest_path_m is None else round(shortest_path_m, 6),
    }


def places_json(starts: Iterable[Pose], goals: Iterable[RobotGoal]) -> dict[str, Json]:
    """Return start and goal of each robot; `shifted`: the goal is shifted as the start is."""
    return {
        "starts": [
            {"x_m": x_m, "y_m": y_m, "heading_deg": _deg(turn_rad)} for x_m, y_m, turn_rad in starts
        ],
        "goals": [{"x_m": x_m, "y_m": y_m, "shifted": shifted} for x_m, y_m, shifted in goals],
    }


def _deg(angle_rad: float) -> float:
    """Return degrees, rounded so that 3 degrees in the file become 3 again."""
    return round(degrees(angle_rad), 9)


def _points(points: tuple[tuple[float, float], ...]) -> Json:
    return [[x, y] for x, y in points]


def _obstacle(obstacle: Obstacle) -> Json:
    if isinstance(obstacle, Polygon):
        return {"polygon_m": _points(obstacle.points_m)}
    if not isinstance(obstacle, Circle):
        return {"wall_m": _points(obstacle.points_m), "thickness_m": obstacle.thickness_m}
    disc: Json = {"x": obstacle.x_m, "y": obstacle.y_m, "radius": obstacle.radius_m}
    if not obstacle.path_m:
        return {"circle_m": disc}
    path = _points(obstacle.path_m)
    return {"circle_m": disc, "path_m": path, "speed_m_s": obstacle.speed_m_s}


def _settings(settings: Settings) -> Json:
    return dict(_setting(name, value) for name, value in settings.items())


def _setting(name: str, value: Setting) -> tuple[str, Json]:
    if name.endswith("_rad") and isinstance(value, float):
        return name.removesuffix("_rad") + "_deg", _deg(value)
    return name, value
