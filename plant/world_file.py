"""A world file is read here: TOML in metres and degrees in, a checked `World` out."""

from plant.world_types import (
    Circle,
    GoalPose,
    Obstacle,
    Point,
    Polygon,
    Polyline,
    Settings,
    Start,
    World,
)

__all__ = [
    "Circle",
    "GoalPose",
    "Obstacle",
    "Point",
    "Polygon",
    "Polyline",
    "Settings",
    "Start",
    "World",
]
