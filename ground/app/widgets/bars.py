"""Bars and sparklines in eighths of a cell."""

from collections.abc import Iterable, Sequence
from math import isfinite, nan
from typing import Final

EIGHTHS: Final = " ▏▎▍▌▋▊▉█"
HEIGHTS: Final = "▁▂▃▄▅▆▇█"
GAP: Final = " "


def bar(share: float, cells: int) -> str:
    """As much of so many cells; the rest is dotted. Anything above a whole is a whole."""
    if not isfinite(share):
        return "·" * cells
    eighths = round(max(0.0, min(1.0, share)) * cells * 8)
    full, rest = divmod(eighths, 8)
    text = "█" * full + (EIGHTHS[rest] if rest else "")
    return text + "·" * (cells - len(text))


def spark(values: Sequence[float], cells: int) -> str:
    """One character for each value, scaled to their own range, right-aligned; gaps stay gaps."""
    values = list(values)[-cells:] if cells > 0 else []
    there = [value for value in values if isfinite(value)]
    low, high = (min(there), max(there)) if there else (0.0, 0.0)
    span = high - low
    text = "".join(height(value, low, span) for value in values)
    return text.rjust(max(0, cells))


def height(value: float, low: float, span: float) -> str:
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
    """The newest value (`peak`: the greatest) of each of so many equal times up to now, NaN where
    there is none.

    The times are on a fixed grid, so that a value stays in its bin while the window moves on.
    """
    step_s = window_s / max(1, cells)
    newest = int(now_s // step_s)
    bins = [nan] * cells
    for time_s, value in points:
        place = int(time_s // step_s) - newest + cells - 1
        if 0 <= place < cells and not (peak and bins[place] > value):
            bins[place] = value
    return bins
