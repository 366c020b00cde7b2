"""Draw a scene on a canvas, layer by layer; later layers cover earlier ones.

Static layers and traces are separate, so that a caller that draws many frames draws each of them
only when it has changed.
"""

from collections.abc import Callable, Collection
from typing import Final

from ground.map import moving_layers, static_layers
from ground.map.canvas import Canvas
from ground.map.legend import GAP, legend
from ground.map.pen import Pen
from ground.map.scene import LAYERS, MapScene
from ground.map.view import MIN_LEGEND_ROWS, View

Layer = Callable[[Pen, MapScene], None]

STATIC: Final[tuple[tuple[str, Layer], ...]] = (
    ("walls", static_layers.draw_walls),
    ("fence", static_layers.draw_fence),
)
TRACES: Final[tuple[tuple[str, Layer], ...]] = (
    ("seen", static_layers.draw_seen),
    ("ghosts", static_layers.draw_ghosts),
    ("trail", moving_layers.draw_trail),
)

BAR_SHARE: Final = 6
"""The scale bar takes at most one of so many columns."""


def draw_legend(pen: Pen, scene: MapScene) -> None:
    """Draw the scale bar and the legend into the last row, when there are rows enough."""
    canvas = pen.canvas
    row = canvas.rows - 1
    if canvas.rows < MIN_LEGEND_ROWS:
        return
    length_m, cells = pen.view.scale_bar(canvas.columns // BAR_SHARE)
    canvas.mark(0, row, "bar left", "text")
    for column in range(1, cells - 1):
        canvas.mark(column, row, "bar", "text")
    canvas.mark(cells - 1, row, "bar right", "text")
    length = length_text(length_m)
    canvas.text(cells + 1, row, length, "text")
    column = cells + len(length) + 3
    room, forms = canvas.columns - column, (canvas.ascii_only, canvas.is_mono)
    for words, role in legend(scene, room, ascii_only=forms[0], is_mono=forms[1]):
        canvas.text(column, row, words, role)
        column += len(words) + len(GAP)


def length_text(length_m: float) -> str:
    """Return a length in a fitting unit: 0.5 mm, 2 cm, 5 m, 2 km."""
    for unit, size_m in (("km", 1000.0), ("m", 1.0), ("cm", 0.01)):
        if length_m >= size_m * 0.999:
            return f"{length_m / size_m:g} {unit}"
    return f"{length_m * 1000.0:g} mm"


MOVING: Final[tuple[tuple[str, Layer], ...]] = (
    ("ellipse", moving_layers.draw_ellipse),
    ("zone", moving_layers.draw_zone),
    ("sonars", moving_layers.draw_sonars),
    ("marks", static_layers.draw_hit_points),
    ("draft", static_layers.draw_draft),
    ("mission", static_layers.draw_mission),
    ("virtual", moving_layers.draw_virtual),
    ("goal", moving_layers.draw_goal),
    ("others", moving_layers.draw_others),
    ("truth", moving_layers.draw_true_robot),
    ("robot", moving_layers.draw_robot),
    ("cursor", moving_layers.draw_cursor),
    ("legend", draw_legend),
)


def draw(scene: MapScene, view: View, canvas: Canvas, layers: Collection[str] = LAYERS) -> None:
    """Draw the named layers of a scene (see `scene.LAYERS`)."""
    draw_static(scene, view, canvas, layers)
    draw_traces(scene, view, canvas, layers)
    draw_moving(scene, view, canvas, layers)


def draw_static(
    scene: MapScene, view: View, canvas: Canvas, layers: Collection[str] = LAYERS
) -> None:
    """Draw the layers that stay the same while `static_parts` does."""
    _draw(STATIC, scene, Pen(canvas, view), layers)


def draw_traces(
    scene: MapScene,
    view: View,
    canvas: Canvas,
    layers: Collection[str] = LAYERS,
    *,
    drawn: int | None = None,
) -> None:
    """Draw the layers above the static ones.

    They change only with `trace_parts` and the trail. The first `drawn` points of the trail are
    already on the canvas; draw the others.
    """
    if drawn is None:
        _draw(TRACES, scene, Pen(canvas, view), layers)
    elif "trail" in layers:
        moving_layers.draw_trail_end(Pen(canvas, view), scene, drawn)


def draw_moving(
    scene: MapScene, view: View, canvas: Canvas, layers: Collection[str] = LAYERS
) -> None:
    """Draw all other layers."""
    _draw(MOVING, scene, Pen(canvas, view), layers)


def static_parts(scene: MapScene) -> tuple[object, ...]:
    """Return the parts of a scene that `draw_static` draws, for comparison."""
    return scene.size_m, scene.obstacles, scene.truth, scene.fence


def trace_parts(scene: MapScene) -> tuple[object, ...]:
    """Return the parts of a scene that `draw_traces` draws, without the trail, for comparison."""
    others = tuple(other.trail for other in scene.others)
    return scene.seen, scene.seen_late, scene.seen_old, scene.ghosts, others


def _draw(
    table: tuple[tuple[str, Layer], ...], scene: MapScene, pen: Pen, layers: Collection[str]
) -> None:
    for name, layer in table:
        if name in layers:
            layer(pen, scene)
