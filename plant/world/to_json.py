"""Convert a world to one JSON object with the keys and units of its file."""

from collections.abc import Callable, Iterable
from math import degrees
from typing import Any, TypeAlias

from plant.model.configuration import noise_of
from plant.model.noise import LEVELS, Noise
from plant.model.scene import Pose
from plant.model.types import Circle, Obstacle, Polygon, Settings, World
from plant.placement.fleet_goals import RobotGoal

Json: TypeAlias = str | bool | int | float | list["Json"] | dict[str, "Json"] | None


def as_json(world: World, shortest_path_m: float | None) -> dict[str, Json]:
    """Return the JSON of a world with its shortest path; angles in degrees, heading null: any."""
    length_m = None if shortest_path_m is None else round(shortest_path_m, 6)
    return {**tables_of(world, _deg), "shortest_path_m": length_m}


def tables_of(world: World, in_degrees: Callable[[float], float]) -> dict[str, Any]:
    """Return the tables of a world's file as lists, numbers and texts; None: any heading."""
    start, goal = world.start, world.goal
    return {
        "name": world.name,
        "size_m": list(world.size_m),
        "walls": world.walls,
        "start": {"x_m": start.x_m, "y_m": start.y_m, "heading_deg": in_degrees(start.heading_rad)},
        "goal": {
            "x_m": goal.x_m,
            "y_m": goal.y_m,
            "heading_deg": None if goal.heading_rad is None else in_degrees(goal.heading_rad),
            "position_tolerance_m": goal.position_tolerance_m,
            "heading_tolerance_deg": in_degrees(goal.heading_tolerance_rad),
        },
        "obstacles": [_obstacle(obstacle) for obstacle in world.obstacles],
        "robot": _settings(world.robot, in_degrees),
        "noise": _settings(world.noise, in_degrees),
        "faults": [_settings(fault, in_degrees) for fault in world.faults],
    }


def run_json(world: World, seed: int, noise: Noise) -> dict[str, Json]:
    """Return what a run needs besides its world: the seed, and a noise that is not the world's."""
    levels = [name for name, level in LEVELS.items() if level == noise]
    other = {} if noise == noise_of(world) or not levels else {"noise_level": levels[0]}
    return {"seed": seed, **other}


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


def _obstacle(obstacle: Obstacle) -> dict[str, Any]:
    if isinstance(obstacle, Polygon):
        return {"polygon_m": list(map(list, obstacle.points_m))}
    if not isinstance(obstacle, Circle):
        wall_m = list(map(list, obstacle.points_m))
        return {"wall_m": wall_m, "thickness_m": obstacle.thickness_m}
    disc = {"x": obstacle.x_m, "y": obstacle.y_m, "radius": obstacle.radius_m}
    if not obstacle.path_m:
        return {"circle_m": disc}
    path_m = list(map(list, obstacle.path_m))
    return {"circle_m": disc, "path_m": path_m, "speed_m_s": obstacle.speed_m_s}


def _settings(settings: Settings, in_degrees: Callable[[float], float]) -> dict[str, Any]:
    return {
        name.removesuffix("_rad") + "_deg" if name.endswith("_rad") else name: (
            in_degrees(float(value)) if name.endswith("_rad") else value
        )
        for name, value in settings.items()
    }
