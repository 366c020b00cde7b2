"""A scene on a canvas, what matters more over what matters less.

What stands still is apart from what moves, so that whoever draws many frames draws it once.
"""

from collections.abc import Callable, Collection
from typing import Final

from ground.map.canvas import Canvas
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
from ground.map.view import LEGEND_FROM_ROWS, View

Layer = Callable[[Pen, Scene], None]

STANDING: Final[tuple[tuple[str, Layer], ...]] = (
    ("walls", draw_walls),
    ("fence", draw_fence),
)


SHARE: Final = 6
TRUTH: Final = "walls: simulation truth"
LOST: Final = "NOT LIVE"


def draw_legend(pen: Pen, scene: Scene) -> None:
    """Only where there are rows enough; over what is on the map there."""
    canvas = pen.canvas
    row = canvas.rows - 1
    if canvas.rows < LEGEND_FROM_ROWS:
        return
    length_m, cells = pen.view.scale_bar(canvas.columns // SHARE)
    canvas.mark(0, row, "bar left", "text")
    for column in range(1, cells - 1):
        canvas.mark(column, row, "bar", "text")
    canvas.mark(cells - 1, row, "bar right", "text")
    length = metres(length_m)
    canvas.text(cells + 1, row, length, "text")
    legend = words(scene, canvas.columns - cells - len(length) - 3)
    canvas.text(canvas.columns - len(legend), row, legend, "text")


def words(scene: Scene, room: int) -> str:
    """The more important first, as much as there is room for."""
    walled = scene.truth and (scene.obstacles or scene.size_m)
    said = ""
    for word in ("" if scene.live else LOST, TRUTH if walled else "", scene.note):
        longer = ", ".join(part for part in (said, word) if part)
        said = longer if len(longer) <= room else said
    return said


def metres(length_m: float) -> str:
    """A length as one says it: 0.5 mm, 2 cm, 5 m, 2 km."""
    for unit, size_m in (("km", 1000.0), ("m", 1.0), ("cm", 0.01)):
        if length_m >= size_m * 0.999:
            return f"{length_m / size_m:g} {unit}"
    return f"{length_m * 1000.0:g} mm"


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
