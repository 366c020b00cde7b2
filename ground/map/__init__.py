"""The map: a scene in metres, a view of it, and a canvas of characters. Knows no terminal."""

from ground.map.canvas import Canvas, Run
from ground.map.description import describe
from ground.map.drawing import draw, draw_moving, draw_standing, standing
from ground.map.roles import ROLES
from ground.map.scene import (
    LAYERS,
    Disc,
    Ghost,
    Outline,
    Robot,
    Scene,
    Shape,
    Target,
    floor,
)
from ground.map.view import Box, Point, View

__all__ = [
    "LAYERS",
    "ROLES",
    "Box",
    "Canvas",
    "Disc",
    "Ghost",
    "Outline",
    "Point",
    "Robot",
    "Run",
    "Scene",
    "Shape",
    "Target",
    "View",
    "describe",
    "draw",
    "draw_moving",
    "draw_standing",
    "floor",
    "standing",
]
