"""The third column: the last minute as sparklines, each with its present value and its range."""

from math import isfinite
from typing import Final, NamedTuple

from ground.app.faces.aged import MISSING, number
from ground.app.faces.bars import binned, spark
from ground.station.station import Station
from ground.widgets.rows import Row, Span, faint, head, row

WIDTH: Final = 32
WINDOW_S: Final = 60.0
FRESH_S: Final = 1.0


class Figure(NamedTuple):
    """A series of the history, its name for people, its unit and its colour."""

    series: str
    says: str
    unit: str
    role: str
    form: str = ".2f"
    factor: float = 1.0


FIGURES: Final = (
    Figure("goal_distance", "to go", "m", "virtual"),
    Figure("speed", "speed", "m/s", "goal"),
    Figure("nearest_range", "nearest", "m", "echo"),
    Figure("cycle_us", "cycle", "us", "mission", ".0f"),
    Figure("uncertainty_m", "σ pose", "mm", "ellipse", ".0f", 1000.0),
    Figure("late_us", "late", "us", "mission", ".0f"),
)


def spark_rows(station: Station, width: int = WIDTH) -> list[Row]:
    return [one for figure in FIGURES for one in figure_rows(station, figure, width)]


def figure_rows(station: Station, figure: Figure, width: int) -> list[Row]:
    series, now_s = station.history[figure.series], station.time_s
    points = series.points(now_s - WINDOW_S)
    values = binned(points, width, now_s, WINDOW_S)
    last = series.last
    fresh = last is not None and now_s - last[0] <= FRESH_S and isfinite(last[1])
    value = last[1] * figure.factor if last is not None and fresh else None
    there = [one * figure.factor for one in values if isfinite(one)]
    ends = f"{min(there):{figure.form}}..{max(there):{figure.form}}" if there else MISSING
    words = f"{number(value, figure.form)} {figure.unit}"
    role = figure.role if fresh else "faint"
    return [
        row(head(f"{figure.says:<8}"), Span(f"{words:<12}", role), faint(f"{ends:>{width - 20}}")),
        row(Span(spark(values, width), role)),
    ]
