"""A scene on a canvas, what matters more over what matters less.

What stands still is apart from what moves, so that whoever draws many frames draws it once.
"""

from collections.abc import Callable, Collection
from typing import Final

from ground.map.canvas import Canvas
from ground.map.legend import draw_legend
from ground.map.moving import (
    draw_cursor,
    draw_ellipse,
    draw_goal,
    draw_others,
    draw_robot,
    draw_sonars,
    draw_trail,
    draw_virtual,
    draw_zone,
)
from ground.map.pen import Pen
from ground.map.scene import LAYERS, Scene
from ground.map.standing import (
    draw_draft,
    draw_fence,
    draw_ghosts,
    draw_marks,
    draw_mission,
    draw_seen,
    draw_walls,
)
from ground.map.view import View

Layer = Callable[[Pen, Scene], None]

STANDING: Final[tuple[tuple[str, Layer], ...]] = (
    ("walls", draw_walls),
    ("fence", draw_fence),
)
MOVING: Final[tuple[tuple[str, Layer], ...]] = (
    ("seen", draw_seen),
    ("ghosts", draw_ghosts),
    ("trail", draw_trail),
    ("ellipse", draw_ellipse),
    ("zone", draw_zone),
    ("sonars", draw_sonars),
    ("marks", draw_marks),
    ("draft", draw_draft),
    ("mission", draw_mission),
    ("virtual", draw_virtual),
    ("goal", draw_goal),
    ("others", draw_others),
    ("robot", draw_robot),
    ("cursor", draw_cursor),
    ("legend", draw_legend),
)


def draw(scene: Scene, view: View, canvas: Canvas, layers: Collection[str] = LAYERS) -> None:
    """All of it; only the layers named (see `scene.LAYERS`)."""
    draw_standing(scene, view, canvas, layers)
    draw_moving(scene, view, canvas, layers)


def draw_standing(
    scene: Scene, view: View, canvas: Canvas, layers: Collection[str] = LAYERS
) -> None:
    """What is the same in every frame while `standing` is."""
    _draw(STANDING, scene, Pen(canvas, view), layers)


def draw_moving(scene: Scene, view: View, canvas: Canvas, layers: Collection[str] = LAYERS) -> None:
    """All the rest."""
    _draw(MOVING, scene, Pen(canvas, view), layers)


def standing(scene: Scene) -> tuple[object, ...]:
    """What `draw_standing` draws, to compare."""
    return scene.size_m, scene.obstacles, scene.truth, scene.fence


def _draw(
    table: tuple[tuple[str, Layer], ...], scene: Scene, pen: Pen, layers: Collection[str]
) -> None:
    for name, layer in table:
        if name in layers:
            layer(pen, scene)
