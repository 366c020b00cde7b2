"""Show the Plots screen: speed, distance, nearest echo, cost and uncertainty over time."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from math import isfinite
from typing import Final

from textual.app import ComposeResult
from textual.containers import Grid

from ground.app.input.default_keys import Layer
from ground.app.panels.aged import MISSING, number
from ground.app.playback.app_interface import AppInterface
from ground.app.screens.app_screen import Action, AppScreen
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.app.widgets.sparklines import FRESH_S, SPARKLINES, Sparkline
from ground.map.canvas import Canvas
from ground.station.station import Station

WINDOWS_S: Final = (15.0, 30.0, 60.0, 120.0, 300.0, 600.0)
DRAWN_HZ: Final = 4.0
LABEL: Final = 8
Point = tuple[float, float]


class PlotsScreen(AppScreen):
    """One plot for each figure."""

    key_layer = Layer.PLOTS

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface)
        self._window = 2
        self._drawn: tuple[object, ...] = ()

    def compose_content(self) -> ComposeResult:
        """Compose heading and plots."""
        yield Lines(id="heading")
        with Grid(id="plots"):
            for figure in SPARKLINES:
                yield Lines(id=f"plot-{figure.series.replace('_', '-')}")

    def draw(self) -> None:
        """Draw at most a few times a second, because every plot changes each time."""
        station, window_s = self.interface.station, WINDOWS_S[self._window]
        panels = [(figure, self.panel(figure)) for figure in SPARKLINES]
        moment = int(station.time_s * DRAWN_HZ)
        state = (moment, self._window, [panel.size for _, panel in panels])
        if state == self._drawn:
            return
        self._drawn = state
        self.lines("heading").show([row(faint(f" the last {window_s:g} s"))])
        for figure, panel in panels:
            panel.show(plot_rows(station, figure, panel.size, window_s, self.interface.ascii_only))

    def panel(self, figure: Sparkline) -> Lines:
        """Return the panel of a figure."""
        return self.lines(f"plot-{figure.series.replace('_', '-')}")

    def actions(self) -> Mapping[str, Action]:
        """Return the actions that are possible now, by id."""
        return {
            **super().actions(),
            "plot-shorter": partial(self.widen, -1),
            "plot-longer": partial(self.widen, 1),
        }

    def widen(self, steps: int) -> None:
        """Change the time span by steps."""
        self._window = max(0, min(len(WINDOWS_S) - 1, self._window + steps))


def plot_rows(
    station: Station, figure: Sparkline, size: tuple[int, int], window_s: float, ascii_only: bool
) -> list[Row]:
    """Return a plot of `size` columns and rows; the first row is the title."""
    columns, rows = size
    now_s = station.time_s
    points = station.history[figure.series].points(now_s - window_s)
    values = [(time_s, value * figure.factor) for time_s, value in points]
    low, high = limits(value for _, value in values)
    canvas = Canvas(max(0, columns - LABEL), max(0, rows - 1), ascii_only)
    draw(canvas, figure.role, values, (now_s - window_s, now_s), (low, high))
    title = title_row(figure, values, now_s)
    labels = axis_labels(canvas.rows, low, high, figure.form if values else "")
    return [
        title,
        *(
            row(faint(label), *(Span(text, role or "text") for role, text in canvas.strip(number)))
            for number, label in enumerate(labels)
        ),
    ]


def title_row(figure: Sparkline, values: Sequence[Point], now_s: float) -> Row:
    """Return the title with the newest value."""
    last = values[-1] if values else None
    fresh = last is not None and now_s - last[0] <= FRESH_S
    words = number(last[1], figure.form) if last is not None and fresh else MISSING
    return row(
        head(f" {figure.label:<9}"),
        Span(f"{words} {figure.unit}", figure.role if fresh else "faint"),
    )


def limits(values: Iterable[float]) -> tuple[float, float]:
    """Return the limits of the axis; it includes zero, because a curve without zero misleads."""
    there = [value for value in values if isfinite(value)]
    if not there:
        return 0.0, 1.0
    low, high = min(0.0, *there), max(there)
    return low, high if high > low else low + 1.0


def axis_labels(rows: int, low: float, high: float, form: str) -> list[str]:
    """Return the labels of all rows: the greatest value at the top, the least at the bottom."""
    words = [""] * rows
    if rows and form:
        words[0], words[-1] = format(high, form), format(low, form) if rows > 1 else words[0]
    return [f"{word:>{LABEL - 1}} " for word in words]


def draw(canvas: Canvas, role: str, values: Sequence[Point], time: Point, value: Point) -> None:
    """Draw lines between neighbouring values, interrupted at gaps."""
    before: tuple[int, int] | None = None
    across = (canvas.width - 1) / (time[1] - time[0])
    up = (canvas.height - 1) / (value[1] - value[0])
    for time_s, one in values:
        if not isfinite(one):
            before = None
            continue
        here = round((time_s - time[0]) * across), round((value[1] - one) * up)
        canvas.line(*(before or here), *here, role)
        before = here
