"""The last row of the map: its scale, and in words what a picture cannot say."""

from typing import Final

from ground.map.pen import Pen
from ground.map.scene import Scene
from ground.map.view import LEGEND_FROM_ROWS

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
