"""Show the Plots screen: figures and chosen fields over time, with a cursor and a pause."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from math import isfinite
from typing import Final, NamedTuple

from textual import events
from textual.app import ComposeResult
from textual.containers import Grid

from ground.app.app_interface import AppInterface
from ground.app.input.keymap import Layer
from ground.app.panels.aged import MISSING, number
from ground.app.screens.app_screen import Action, AppScreen
from ground.app.widgets.bars import FRESH_S, SPARKLINES, Sparkline
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.map.canvas import Canvas
from ground.station.history.time_series import SERIES, Series, numeric_fields
from ground.station.station import Station
from ground.user.folders import free_path
from runtime.files import drafted, replace_named

WINDOWS_S: Final = (15.0, 30.0, 60.0, 120.0, 300.0, 600.0)
DRAWN_HZ: Final = 4.0
LABEL: Final = 8
MAX_PLOTS: Final = 6
FAR: Final = 10
STEPS: Final = 60
"""Steps of the cursor across the time span."""
ROLES: Final = ("trail", "ellipse", "mission", "virtual", "goal", "echo")
"""The colours of chosen fields, by the place of their plot."""
FIGURES: Final = {figure.label: figure for figure in SPARKLINES}
Point = tuple[float, float]


class TimeSpan(NamedTuple):
    """The time span that is plotted, and the time of the cursor, in s of the station."""

    window_s: float
    end_s: float
    cursor_s: float | None = None

    @property
    def begin_s(self) -> float:
        """The begin of the span."""
        return self.end_s - self.window_s


class PlotsScreen(AppScreen):
    """Up to six plots of figures and of fields of messages."""

    key_layer = Layer.PLOTS

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface)
        self._window = 2
        self._chosen = list(FIGURES)
        self._paused_s: float | None = None
        self._cursor_s: float | None = None
        self._drawn: tuple[object, ...] = ()

    def compose_content(self) -> ComposeResult:
        """Compose heading, plots and time axis."""
        yield Lines(id="heading")
        with Grid(id="plots"):
            for number in range(MAX_PLOTS):
                yield Lines(id=f"plot-{number}")
        yield Lines(id="time-axis")

    def span(self) -> TimeSpan:
        """Return the time span that is shown."""
        now_s = self.interface.station.time_s
        end_s = now_s if self._paused_s is None else self._paused_s
        return TimeSpan(WINDOWS_S[self._window], end_s, self._cursor_s)

    def draw(self) -> None:
        """Draw at most a few times a second, because every plot changes each time."""
        station, span = self.interface.station, self.span()
        station.fields.watch(key for key in self._chosen if key not in FIGURES)
        panels = [self.lines(f"plot-{number}") for number in range(MAX_PLOTS)]
        moment = int(span.end_s * DRAWN_HZ)
        sizes = [panel.size for panel in panels]
        state = (moment, self._window, self._cursor_s, tuple(self._chosen), sizes, self._paused_s)
        if state == self._drawn:
            return
        self._drawn = state
        self.lines("heading").show([self.heading(span)])
        is_wide = self.has_class("-wide") or self.has_class("-huge")
        columns = 2 if is_wide else 1
        self.query_one("#plots").styles.grid_size_rows = -(-len(self._chosen) // columns) or 1
        for place, panel in enumerate(panels):
            panel.display = place < len(self._chosen)
            if panel.display:
                figure = figure_of(self._chosen[place], place)
                panel.show(plot_rows(station, figure, panel.size, span, self.interface.ascii_only))
        self.lines("time-axis").show([axis_row(span, self.size.width, columns)])

    def heading(self, span: TimeSpan) -> Row:
        """Return the time span, the pause and the cursor."""
        spans = [faint(f" the last {span.window_s:g} s")]
        if self._paused_s is not None:
            spans.append(Span("   paused, p goes on", "caution"))
        if span.cursor_s is not None:
            ago_s = span.end_s - span.cursor_s
            spans.append(Span(f"   values at -{ago_s:.1f} s, Esc removes the cursor", "accent"))
        return tuple(spans)

    def actions(self) -> Mapping[str, Action]:
        """Return the actions that are possible now, by id."""
        return {
            **super().actions(),
            "plot-shorter": partial(self.widen, -1),
            "plot-longer": partial(self.widen, 1),
            "plot-choose": self.choose_series,
            "find": self.choose_series,
            "plot-pause": self.pause,
            "plot-export": self.export,
            "plot-cursor-left": partial(self.move_cursor, -1),
            "plot-cursor-right": partial(self.move_cursor, 1),
            "plot-cursor-left-far": partial(self.move_cursor, -FAR),
            "plot-cursor-right-far": partial(self.move_cursor, FAR),
        }

    def export(self) -> None:
        """Write one of the plots, as it is shown, to a picture and a table."""

        def write(key: str) -> None:
            figure, span = figure_of(key, self._chosen.index(key)), self.span()
            points = values_in(self.interface.station, figure, span)
            self.interface.run_in_background(
                partial(exported, figure, span, points), self.interface.note
            )

        if len(self._chosen) == 1:
            write(self._chosen[0])
        else:
            self.interface.choose("export a plot", self._chosen, write)

    def widen(self, steps: int) -> None:
        """Change the time span by steps."""
        self._window = max(0, min(len(WINDOWS_S) - 1, self._window + steps))

    def pause(self) -> None:
        """Pause, or show the present again."""
        self._paused_s = self.interface.station.time_s if self._paused_s is None else None

    def move_cursor(self, steps: int) -> None:
        """Move the cursor; the first step places it at the end of the span, and pauses."""
        if self._paused_s is None:
            self.pause()
        span = self.span()
        at_s = span.end_s if span.cursor_s is None else span.cursor_s
        moved_s = at_s + steps * span.window_s / STEPS
        self._cursor_s = max(span.begin_s, min(span.end_s, moved_s))

    def close_what_is_open(self) -> None:
        """Remove the cursor, and go on."""
        self._cursor_s = self._paused_s = None

    def on_click(self, event: events.Click) -> None:
        """Place the cursor at the time that was clicked."""
        panel = event.widget
        if isinstance(panel, Lines) and (panel.id or "").startswith("plot-"):
            span, columns = self.span(), max(1, panel.size.width - LABEL - 1)
            share = max(0.0, min(1.0, (event.x - LABEL) / columns))
            self._paused_s = span.end_s
            self._cursor_s = span.begin_s + share * span.window_s
            self.redraw()

    # The choice of series.

    def choose_series(self) -> None:
        """Let the operator add or remove a plot."""
        from ground.app.screens.choice import Choice  # rarely needed, so imported late

        shown = [Choice(key, is_current=key in self._chosen) for key in FIGURES]
        fields = [
            Choice(key, field.unit, is_current=key in self._chosen)
            for key, field in numeric_fields().items()
        ]
        title = "plots: Enter adds or removes one"
        self.interface.choose(title, [*shown, *fields], self.switch_series)

    def switch_series(self, key: str) -> None:
        """Add a plot, or remove it if it is there."""
        if key in self._chosen:
            self._chosen.remove(key)
            return
        if len(self._chosen) >= MAX_PLOTS:
            self.interface.note(f"{key} replaces {self._chosen.pop()}: {MAX_PLOTS} plots at most")
        self._chosen.append(key)


def figure_of(key: str, number: int) -> Sparkline:
    """Return the figure with this label, or that of a field in place `number`."""
    if key in FIGURES:
        return FIGURES[key]
    return Sparkline(key, key, numeric_fields()[key].unit, ROLES[number], ".4g")


def series_of(station: Station, figure: Sparkline) -> Series:
    """Return the values of a figure."""
    if figure.series in SERIES:
        return station.history[figure.series]
    return station.fields.series.get(figure.series) or Series()


def values_in(station: Station, figure: Sparkline, span: TimeSpan) -> list[Point]:
    """Return the values of a figure in a time span, in its unit."""
    every = series_of(station, figure).points(span.begin_s)
    return [(time_s, value * figure.factor) for time_s, value in every if time_s <= span.end_s]


def exported(figure: Sparkline, span: TimeSpan, points: Sequence[Point]) -> str:
    """Write a plot as CSV and, where matplotlib is installed, as SVG; return the paths."""
    table = free_path("plot", ".csv")
    rows = [f"{time_s - span.end_s:.3f},{value:.9g}" for time_s, value in points]
    unit = f" [{figure.unit}]" if figure.unit else ""
    replace_named(table, "\n".join([f"time before the end [s],{figure.label}{unit}", *rows, ""]))
    try:
        from matplotlib.figure import Figure  # slow to import, and in an extra
    except ImportError:
        return f"saved {table}; a picture needs pip install 'sidestep[study]'"
    drawing = Figure(figsize=(8.0, 3.0), layout="constrained")
    axes = drawing.subplots()
    axes.plot([time_s - span.end_s for time_s, _ in points], [value for _, value in points])
    axes.set(xlabel="time before the end [s]", ylabel=f"{figure.label}{unit}")
    axes.set_xlim(-span.window_s, 0.0)
    axes.grid(visible=True, alpha=0.3)
    with drafted(table.with_suffix(".svg")) as draft:
        drawing.savefig(draft)
    return f"saved {table.with_suffix('.svg')} and {table.name}"


def axis_row(span: TimeSpan, width: int, columns: int) -> Row:
    """Return the time axis below each column of plots, in seconds before the end."""
    wide = (width - (columns - 1)) // columns
    room = max(0, wide - LABEL)
    ends = f"-{span.window_s:g} s", f"-{span.window_s / 2:g} s", "0 s"
    middle = room // 2 - len(ends[1]) // 2 - len(ends[0])
    right = room - len(ends[0]) - max(1, middle) - len(ends[1]) - len(ends[2])
    if right < 1:
        return row(faint(f"{ends[0]:>{LABEL}} to 0 s"))
    axis = f"{'':{LABEL}}{ends[0]}{'':{max(1, middle)}}{ends[1]}{'':{right}}{ends[2]}"
    return row(faint(" ".join([axis] * columns)))


def plot_rows(
    station: Station, figure: Sparkline, size: tuple[int, int], span: TimeSpan, ascii_only: bool
) -> list[Row]:
    """Return a plot of `size` columns and rows; the first row is the title."""
    columns, rows = size
    values = values_in(station, figure, span)
    low, high = limits((value for _, value in values), with_zero=figure.series in SERIES)
    canvas = Canvas(max(0, columns - LABEL), max(0, rows - 1), ascii_only)
    draw_cursor(canvas, span)
    draw(canvas, figure.role, values, (span.begin_s, span.end_s), (low, high))
    title = title_row(figure, values, span)
    labels = axis_labels(canvas.rows, low, high, figure.form if values else "")
    return [
        title,
        *(
            row(faint(label), *(Span(text, role or "text") for role, text in canvas.strip(number)))
            for number, label in enumerate(labels)
        ),
    ]


def title_row(figure: Sparkline, values: Sequence[Point], span: TimeSpan) -> Row:
    """Return the title with the value at the cursor, else the newest one."""
    at_s = span.end_s if span.cursor_s is None else span.cursor_s
    nearest = min(values, key=lambda point: abs(point[0] - at_s), default=None)
    fresh = nearest is not None and abs(at_s - nearest[0]) <= FRESH_S
    words = number(nearest[1], figure.form) if nearest is not None and fresh else MISSING
    return row(
        head(f" {figure.label:<9} "),
        Span(f"{words} {figure.unit}", figure.role if fresh else "faint"),
    )


def draw_cursor(canvas: Canvas, span: TimeSpan) -> None:
    """Draw the cursor as a vertical line."""
    if span.cursor_s is not None and canvas.width:
        share = (span.cursor_s - span.begin_s) / span.window_s
        x = round(share * (canvas.width - 1))
        canvas.line(x, 0, x, canvas.height - 1, "ghost")


def limits(values: Iterable[float], *, with_zero: bool) -> tuple[float, float]:
    """Return the limits of the axis; zero belongs to figures, whose size matters."""
    there = [value for value in values if isfinite(value)]
    if not there:
        return 0.0, 1.0
    low, high = min(there), max(there)
    if with_zero:
        low = min(0.0, low)
    return low, high if high > low else low + 1.0


def axis_labels(rows: int, low: float, high: float, form: str) -> list[str]:
    """Return the labels of all rows: the greatest value at the top, the least at the bottom."""
    words = [""] * rows
    if rows and form:
        words[0], words[-1] = number(high, form), number(low, form) if rows > 1 else words[0]
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
