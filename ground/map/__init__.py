"""Draw a scene, given in metres, through a view onto a canvas of characters.

No terminal is needed.
"""

from ground.map.canvas import Canvas, Run
from ground.map.drawing import draw, draw_moving, draw_static, static_parts
from ground.map.roles import ROLES
from ground.map.scene import (
    LAYERS,
    Disc,
    GhostTrail,
    MapScene,
    MapTarget,
    Outline,
    RobotMark,
    Shape,
    floor,
)
from ground.map.view import Box, Point, View

__all__ = [
    "LAYERS",
    "ROLES",
    "Box",
    "Canvas",
    "Disc",
    "GhostTrail",
    "MapScene",
    "MapTarget",
    "Outline",
    "Point",
    "RobotMark",
    "Run",
    "Shape",
    "View",
    "draw",
    "draw_moving",
    "draw_static",
    "floor",
    "static_parts",
]
