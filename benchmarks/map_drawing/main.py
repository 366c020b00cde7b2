"""A frame of the map on 100 x 40 cells in truecolor, textual-plotext beside it.

Both draw the same lines in one run and in turns: 14 obstacles, a trail that moves with every frame,
sonar cones, an ellipse, goals. Ours draws marks, words and dotted lines besides.
"""

import argparse
from functools import partial
from typing import Final

from rich.color import Color
from rich.style import Style

from benchmarks.map_drawing.plotext import Lines, PlotextMap
from benchmarks.map_drawing.scene import Noted, drive, noted, segments, whirl
from benchmarks.map_drawing.stage import Cost, perform
from ground.app.widgets.map import MapWidget
from ground.map import Scene
from verification.harness.figures import Figure, Report, ratios

AT_MOST_MS: Final = 4.0
AT_MOST_RATIO: Final = 0.2
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
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--frames", type=int, default=100, help="of ours, per repetition")


def measure(options: argparse.Namespace) -> Report:
    hard, easy = whirl(options.frames), drive(options.frames)
    plotext = [noted(scene, *SIZE) for scene in hard[: max(10, options.frames // 4)]]
    whirled, driven, theirs = [], [], []
    for _ in range(options.repetitions):
        whirled.append(ours(hard))
        theirs.append(peer(plotext))
        driven.append(ours(easy))
    count = segments(plotext[0])
    return Report(
        benchmark="map",
        figures=figures(whirled, driven, theirs),
        notes=(
            f"{count} segments, the same for both; {len(hard)} frames of ours and"
            f" {len(plotext)} of textual-plotext per repetition, the median of each",
            "CPU time of the thread, Textual's share and the text for the terminal included",
            "all moves: every point of the trail is elsewhere in each frame, the walls are not;"
            " driving: the trail grows at its end",
        ),
    )


def figures(whirled: list[Cost], driven: list[Cost], theirs: list[Cost]) -> tuple[Figure, ...]:
    ours_ms = [cost.median_ms for cost in whirled]
    theirs_ms = [cost.median_ms for cost in theirs]
    quotients = ratios(ours_ms, theirs_ms)
    return (
        Figure(name="frame, all moves", unit="ms", values=tuple(ours_ms), at_most=AT_MOST_MS),
        Figure(name="ours / textual-plotext", unit="x", values=quotients, at_most=AT_MOST_RATIO),
        Figure(name="frame, driving", unit="ms", values=tuple(c.median_ms for c in driven)),
        Figure(name="frame, textual-plotext", unit="ms", values=tuple(theirs_ms)),
        Figure(name="written, all moves", unit="kB", values=tuple(c.median_kb for c in whirled)),
        Figure(name="written, driving", unit="kB", values=tuple(c.median_kb for c in driven)),
        Figure(
            name="written, textual-plotext", unit="kB", values=tuple(c.median_kb for c in theirs)
        ),
    )


def ours(scenes: list[Scene]) -> Cost:
    styles = {role: Style(color=colour) for role, colour in COLOURS.items()}
    widget = MapWidget(styles)
    return perform(widget, [partial(widget.show, scene) for scene in scenes], SIZE)


def peer(drawn: list[Noted]) -> Cost:
    widget = PlotextMap()
    return perform(widget, [partial(widget.show, lines_of(canvas)) for canvas in drawn], SIZE)


def lines_of(canvas: Noted) -> Lines:
    return [
        (Color.parse(COLOURS[role]).get_truecolor(), dots)
        for role, dots in canvas.polylines
        if len(dots) > 1
    ]
