"""A frame of the map on 100 x 40 cells in truecolor, compared with textual-plotext.

Both draw the same lines in turn: 14 obstacles, a trail that changes with every frame, sonar cones,
an ellipse, goals. Ours also draws marks, words and dotted lines. The app paints frame after frame
of one widget, on a driver that counts its output.
"""

import argparse
import asyncio
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import atan2, cos, sin
from statistics import median
from time import thread_time
from typing import Any, Final

from rich.color import Color
from rich.console import Console
from rich.style import Style
from textual.app import App, ComposeResult
from textual.drivers.headless_driver import HeadlessDriver
from textual.pilot import Pilot
from textual.widget import Widget
from textual_plotext import PlotextPlot

from checks.harness.figures import BenchmarkReport, Figure, figure, ratios
from ground.app.widgets.map import MapWidget
from ground.map.canvas import Canvas, Dot
from ground.map.drawing import draw
from ground.map.scene import (
    Disc,
    MapScene,
    MapTarget,
    Outline,
    Point,
    RobotMark,
    Shape,
    View,
    floor,
)
from protocol.ring import RADIUS_M

Lines = Sequence[tuple[tuple[int, int, int], Sequence[Dot]]]
"""Colour of each polyline, and its points in dots from the upper left corner."""


class PlotextMap(PlotextPlot):
    """A plot in Braille without axes, which fills the widget."""

    def show(self, lines: Lines) -> None:
        """Draw these lines."""
        plot, (wide, high) = self.plt, (2 * self.size.width, 4 * self.size.height)
        plot.clear_data()
        plot.frame(False)
        plot.xticks([])
        plot.yticks([])
        plot.xlim(0, wide - 1)
        plot.ylim(0, high - 1)
        for colour, dots in lines:
            xs = [x for x, _ in dots]
            ys = [high - 1 - y for _, y in dots]
            plot.plot(xs, ys, marker="braille", color=colour)
        self.refresh()


TRAIL_POINTS: Final = 360
SIZE_M: Final = (10.0, 8.0)
BOX_M: Final = 0.6
DISCS: Final = (Disc(7.6, 2.0, 0.35), Disc(8.2, 5.0, 0.5))
RANGES_M: Final = (0.4, 0.7, 1.1, 1.6, 2.2, 1.3, 0.9, 0.5)


class RecordingCanvas(Canvas):
    """A canvas that records its lines, so that another widget can draw the same."""

    def __init__(self, columns: int, rows: int) -> None:
        super().__init__(columns, rows)
        self.polylines: list[tuple[str, list[Dot]]] = []

    def polyline(self, dots: Iterable[Dot], role: str) -> None:
        """Record and draw a line."""
        recorded_canvas = list(dots)
        self.polylines.append((role, recorded_canvas))
        super().polyline(recorded_canvas, role)


def driving_trails(count: int) -> list[MapScene]:
    """Return scenes of a drive: the trail grows by one step per frame."""
    way = [_place(step, 0.0) for step in range(TRAIL_POINTS + count)]
    obstacles = _obstacles()
    return [_scene(tuple(way[i : i + TRAIL_POINTS]), obstacles) for i in range(count)]


def moving_trails(count: int) -> list[MapScene]:
    """Return the most expensive scenes: the whole trail moves with each frame."""
    obstacles = _obstacles()
    return [
        _scene(tuple(_place(step, 0.03 * i) for step in range(TRAIL_POINTS)), obstacles)
        for i in range(count)
    ]


def recorded_canvas(scene: MapScene, columns: int, rows: int) -> RecordingCanvas:
    """Draw a scene and return its lines in dots."""
    canvas = RecordingCanvas(columns, rows)
    draw(scene, View.fit(scene.box(), columns, rows), canvas)
    return canvas


def segments(canvas: RecordingCanvas) -> int:
    """Return the number of line segments."""
    return sum(len(dots) - 1 for _, dots in canvas.polylines if dots)


def _scene(trail: tuple[Point, ...], obstacles: tuple[Shape, ...]) -> MapScene:
    (before_x_m, before_y_m), (x_m, y_m) = trail[-2:]
    heading_rad = atan2(y_m - before_y_m, x_m - before_x_m)
    return MapScene(
        size_m=SIZE_M,
        obstacles=obstacles,
        trail=trail,
        robot=RobotMark(x_m, y_m, heading_rad, RADIUS_M),
        covariance=(0.02, 0.008, 0.01),
        ranges_m=RANGES_M,
        zone_m=0.3,
        goal=MapTarget(9.2, 7.2, 0.5, 0.1),
        virtual_goal=(x_m + 2.0 * cos(heading_rad), y_m + 2.0 * sin(heading_rad)),
    )


def _place(step: int, phase_rad: float) -> Point:
    x_rad, y_rad = 0.0131 * step + phase_rad, 0.0217 * step + 0.4
    return 5.0 + 4.4 * sin(x_rad), 4.0 + 3.4 * sin(y_rad)


def _obstacles() -> tuple[Shape, ...]:
    corners = [(1.0 + 1.6 * column, 1.0 + 2.2 * row) for column in range(4) for row in range(3)]
    boxes = [
        Outline(((x, y), (x + BOX_M, y), (x + BOX_M, y + BOX_M), (x, y + BOX_M)))
        for x, y in corners
    ]
    return (Outline(floor(SIZE_M)), *boxes, *DISCS)


PATIENCE_S: Final = 120.0
WARM_UP: Final = 5


@dataclass(slots=True)
class FrameCost:
    """CPU time and output of each frame."""

    cpu_ms: list[float] = field(default_factory=list)
    written_kb: list[float] = field(default_factory=list)

    @property
    def median_ms(self) -> float:
        """Median CPU time of a frame."""
        return median(self.cpu_ms)

    @property
    def median_kb(self) -> float:
        """Median output of a frame."""
        return median(self.written_kb)


class CountingDriver(HeadlessDriver):
    """Accept output at full speed and count it."""

    def __init__(self, app: "BenchmarkApp", **options: Any) -> None:
        super().__init__(app, **options)
        app.terminal = self
        self.written = 0
        self.painted = asyncio.Event()

    @property
    def is_headless(self) -> bool:
        """False, as Textual would not write to a headless driver."""
        return False

    def write(self, data: str) -> None:
        """Count output."""
        self.written += len(data.encode())
        self.painted.set()


class BenchmarkApp(App[None]):
    """An app with one widget on the whole screen."""

    terminal: CountingDriver

    def __init__(self, widget: Widget) -> None:
        super().__init__(driver_class=CountingDriver)
        file = self.console.file
        self.console = Console(color_system="truecolor", file=file, force_terminal=True)
        self.widget = widget

    def compose(self) -> ComposeResult:
        """Return the widget."""
        yield self.widget


def measure_frames(
    widget: Widget, frames: Iterable[Callable[[], None]], size: tuple[int, int]
) -> FrameCost:
    """Return the CPU time of the thread from paint to paint, Textual's share included."""
    stage, cost = BenchmarkApp(widget), FrameCost()

    async def play(_: Pilot[object]) -> None:
        for number, frame in enumerate(frames):
            stage.terminal.painted.clear()
            begun_s, stage.terminal.written = thread_time(), 0
            frame()
            await stage.terminal.painted.wait()
            if number >= WARM_UP:
                cost.cpu_ms.append((thread_time() - begun_s) * 1e3)
                cost.written_kb.append(stage.terminal.written / 1e3)
        stage.exit()

    async def play_in_time(pilot: Pilot[object]) -> None:
        await asyncio.wait_for(play(pilot), PATIENCE_S)

    stage.run(size=size, auto_pilot=play_in_time)
    return cost


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


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Measure both in turn."""
    hard, easy = moving_trails(options.frames), driving_trails(options.frames)
    plotext = [recorded_canvas(scene, *SIZE) for scene in hard[: max(10, options.frames // 4)]]
    moving, driving, theirs = [], [], []
    for _ in range(options.repetitions):
        moving.append(ours(hard))
        theirs.append(peer(plotext))
        driving.append(ours(easy))
    count = segments(plotext[0])
    return BenchmarkReport(
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
        figure("frame, all moves", ours_ms, "ms", at_most=MAX_FRAME_MS),
        figure("ours / textual-plotext", quotients, "x", at_most=MAX_RATIO),
        figure("frame, driving", [c.median_ms for c in driving], "ms"),
        figure("frame, textual-plotext", theirs_ms, "ms"),
        figure("written, all moves", [c.median_kb for c in moving], "kB"),
        figure("written, driving", [c.median_kb for c in driving], "kB"),
        figure("written, textual-plotext", [c.median_kb for c in theirs], "kB"),
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
