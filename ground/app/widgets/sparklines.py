"""Show the last minute as sparklines, each with its present value and its range."""

from math import inf, isfinite, nan
from typing import Final, NamedTuple

from ground.app.panels.aged import MISSING, number
from ground.app.widgets.bars import binned, spark
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.station.station import Station

WIDTH: Final = 32
WINDOW_S: Final = 60.0
FRESH_S: Final = 1.0


class Sparkline(NamedTuple):
    """A series of the history, with its label, unit and colour.

    With `peak`, the greatest of the values in a bin is shown, so that the value is readable.
    """

    series: str
    label: str
    unit: str
    role: str
    form: str = ".2f"
    factor: float = 1.0
    peak: bool = False


SPARKLINES: Final = (
    Sparkline("goal_distance", "to go", "m", "virtual"),
    Sparkline("speed", "speed", "m/s", "goal"),
    Sparkline("nearest_range", "nearest", "m", "echo"),
    Sparkline("cycle_us", "cycle", "us", "mission", ".0f", peak=True),
    Sparkline("uncertainty_m", "σ pose", "mm", "ellipse", ".0f", 1000.0),
    Sparkline("late_us", "late", "us", "mission", ".0f", peak=True),
)


def spark_rows(station: Station, width: int = WIDTH) -> list[Row]:
    """Return the rows of all sparklines."""
    return [one for figure in SPARKLINES for one in figure_rows(station, figure, width)]


def figure_rows(station: Station, figure: Sparkline, width: int) -> list[Row]:
    """Return a title with value and range, and the sparkline."""
    series, now_s = station.history[figure.series], station.time_s
    points = series.points(now_s - WINDOW_S)
    values = binned(points, width, now_s, WINDOW_S, peak=figure.peak)
    time_s, newest = series.last or (-inf, nan)
    fresh = now_s - time_s <= FRESH_S and isfinite(newest)
    peaks = [one for one in values if isfinite(one)] if figure.peak else []
    value = (peaks or [newest])[-1] * figure.factor if fresh else None
    there = [one * figure.factor for one in values if isfinite(one)]
    ends = f"{min(there):{figure.form}}..{max(there):{figure.form}}" if there else MISSING
    words = f"{number(value, figure.form)} {figure.unit}"
    role = figure.role if fresh else "faint"
    label = f"{figure.label}≤" if figure.peak else figure.label
    return [
        row(head(f"{label:<8}"), Span(f"{words:<12}", role), faint(f"{ends:>{width - 20}}")),
        row(Span(spark(values, width), role)),
    ]
