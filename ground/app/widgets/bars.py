"""Draw bars in eighths of a cell, and the last minute of values as sparklines with their range."""

from collections.abc import Iterable, Sequence
from math import inf, isfinite, nan
from typing import Final, NamedTuple

from ground.app.panels.aged import MISSING, number
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.station.station import Station

EIGHTHS: Final = " ▏▎▍▌▋▊▉█"
HEIGHTS: Final = "▁▂▃▄▅▆▇█"
GAP: Final = " "


def bar(share: float, cells: int) -> str:
    """Return a bar of `cells` cells with this share filled.

    Shares above 1 fill the whole bar; a share that is not finite fills nothing.
    """
    if not isfinite(share):
        return "·" * cells
    eighths = round(max(0.0, min(1.0, share)) * cells * 8)
    full, rest = divmod(eighths, 8)
    text = "█" * full + (EIGHTHS[rest] if rest else "")
    return text + "·" * (cells - len(text))


def spark(values: Sequence[float], cells: int) -> str:
    """Return one character for each value, scaled to their range; NaN is a gap.

    The result is right-aligned.
    """
    values = list(values)[-cells:] if cells > 0 else []
    there = [value for value in values if isfinite(value)]
    low, high = (min(there), max(there)) if there else (0.0, 0.0)
    span = high - low
    text = "".join(height(value, low, span) for value in values)
    return text.rjust(max(0, cells))


def height(value: float, low: float, span: float) -> str:
    """Return the character for a value."""
    if not isfinite(value):
        return GAP
    if span <= 0.0:
        return HEIGHTS[0]
    return HEIGHTS[min(len(HEIGHTS) - 1, int((value - low) / span * len(HEIGHTS)))]


def binned(
    points: Iterable[tuple[float, float]],
    cells: int,
    now_s: float,
    window_s: float,
    *,
    peak: bool = False,
) -> list[float]:
    """Return the newest value (`peak`: the greatest) of each of `cells` bins up to now.

    Empty bins have NaN.

    The bins are on a fixed time grid, so that a value stays in its bin while the window moves.
    """
    step_s = window_s / max(1, cells)
    newest = int(now_s // step_s)
    bins = [nan] * cells
    for time_s, value in points:
        place = int(time_s // step_s) - newest + cells - 1
        if 0 <= place < cells and not (peak and bins[place] > value):
            bins[place] = value
    return bins


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
    Sparkline("speed", "speed", "m/s", "goal"),
    Sparkline("nearest_range", "near", "m", "echo"),
    Sparkline("uncertainty_m", "doubt", "mm", "ellipse", ".0f", 1000.0),
    Sparkline("cycle_us", "loop", "ms", "mission", ".2f", 0.001, peak=True),
    Sparkline("goal_distance", "to go", "m", "virtual"),
    Sparkline("late_us", "late", "ms", "mission", ".2f", 0.001, peak=True),
)
LABEL: Final = 6
VALUE: Final = 9
ENDS: Final = 11


def spark_rows(station: Station, width: int, most: int) -> list[Row]:
    """Return the rows of the first `most` sparklines."""
    return [figure_row(station, figure, width) for figure in SPARKLINES[:most]]


def figure_row(station: Station, figure: Sparkline, width: int) -> Row:
    """Return label, value, sparkline and range of the last minute."""
    series, now_s = station.history[figure.series], station.time_s
    points = series.points(now_s - WINDOW_S)
    cells = max(1, width - LABEL - VALUE - ENDS)
    values = binned(points, cells, now_s, WINDOW_S, peak=figure.peak)
    time_s, newest = series.last or (-inf, nan)
    fresh = now_s - time_s <= FRESH_S and isfinite(newest)
    peaks = [one for one in values if isfinite(one)] if figure.peak else []
    value = (peaks or [newest])[-1] * figure.factor if fresh else None
    there = [one * figure.factor for one in values if isfinite(one)]
    ends = (
        f"{number(min(there), figure.form)}..{number(max(there), figure.form)}"
        if there
        else MISSING
    )
    words = f"{number(value, figure.form)} {figure.unit}"
    role = figure.role if fresh else "faint"
    return row(
        head(f"{figure.label:<{LABEL}}"),
        Span(f"{words:<{VALUE}}", role),
        Span(spark(values, cells), role),
        faint(f"{ends:>{ENDS}}"),
    )
