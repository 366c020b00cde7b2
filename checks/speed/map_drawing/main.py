"""A frame of the map on 100 x 40 cells in truecolor, compared with textual-plotext.

Both draw the same lines in turn: 14 obstacles, a trail that changes with every frame, sonar cones,
an ellipse, goals. Ours also draws marks, words and dotted lines.
"""

import argparse
from functools import partial
from typing import Final

from rich.color import Color
from rich.style import Style

from checks.harness.figures import Figure, Report, ratios
from checks.speed.map_drawing.plotext import Lines, PlotextMap
from checks.speed.map_drawing.scene import (
    RecordingCanvas,
    driving_trails,
    moving_trails,
    recorded_canvas,
    segments,
)
from checks.speed.map_drawing.stage import FrameCost, measure_frames
from ground.app.widgets.map import MapWidget
from ground.map.scene import MapScene

MAX_FRAME_MS: Final = 4.0
MAX_RATIO: Final = 0.2
SIZE: Final = (100, 40)
COLOURS: Final = {
    "truth": "#808080",
    "trail": "#00d0d0",
    "ellipse": "#d000d0",
    "zone": "#d0a000",
    "cone": "#606060",
    "echo": "#e0e000",
    "goal": "#00e000",
    "virtual": "#4080ff",
    "robot": "#ffffff",
    "text": "#c0c0c0",
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--frames", type=int, default=100, help="of ours, per repetition")


def measure(options: argparse.Namespace) -> Report:
    """Measure both in turn."""
    hard, easy = moving_trails(options.frames), driving_trails(options.frames)
    plotext = [recorded_canvas(scene, *SIZE) for scene in hard[: max(10, options.frames // 4)]]
    moving, driving, theirs = [], [], []
    for _ in range(options.repetitions):
        moving.append(ours(hard))
        theirs.append(peer(plotext))
        driving.append(ours(easy))
    count = segments(plotext[0])
    return Report(
        benchmark="map",
        figures=figures(moving, driving, theirs),
        notes=(
            f"{count} segments, the same for both; {len(hard)} frames of ours and"
            f" {len(plotext)} of textual-plotext per repetition, the median of each",
            "CPU time of the thread, Textual's share and the text for the terminal included",
            "all moves: every point of the trail changes in each frame, the walls do not;"
            " driving: the trail grows at its end",
        ),
    )


def figures(
    moving: list[FrameCost], driving: list[FrameCost], theirs: list[FrameCost]
) -> tuple[Figure, ...]:
    """Return the figures of both."""
    ours_ms = [cost.median_ms for cost in moving]
    theirs_ms = [cost.median_ms for cost in theirs]
    quotients = ratios(ours_ms, theirs_ms)
    return (
        Figure(name="frame, all moves", unit="ms", values=tuple(ours_ms), at_most=MAX_FRAME_MS),
        Figure(name="ours / textual-plotext", unit="x", values=quotients, at_most=MAX_RATIO),
        Figure(name="frame, driving", unit="ms", values=tuple(c.median_ms for c in driving)),
        Figure(name="frame, textual-plotext", unit="ms", values=tuple(theirs_ms)),
        Figure(name="written, all moves", unit="kB", values=tuple(c.median_kb for c in moving)),
        Figure(name="written, driving", unit="kB", values=tuple(c.median_kb for c in driving)),
        Figure(
            name="written, textual-plotext", unit="kB", values=tuple(c.median_kb for c in theirs)
        ),
    )


def ours(scenes: list[MapScene]) -> FrameCost:
    """Draw the scenes with our widget."""
    styles = {role: Style(color=colour) for role, colour in COLOURS.items()}
    widget = MapWidget(styles)
    return measure_frames(widget, [partial(widget.show, scene) for scene in scenes], SIZE)


def peer(drawn: list[RecordingCanvas]) -> FrameCost:
    """Draw the lines with textual-plotext."""
    widget = PlotextMap()
    return measure_frames(
        widget, [partial(widget.show, lines_of(canvas)) for canvas in drawn], SIZE
    )


def lines_of(canvas: RecordingCanvas) -> Lines:
    """Return the lines of a recorded canvas with their colours."""
    return [
        (Color.parse(COLOURS[role]).get_truecolor(), dots)
        for role, dots in canvas.polylines
        if len(dots) > 1
    ]
