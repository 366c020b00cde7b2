"""Draw bars and sparklines in eighths of a cell."""

from collections.abc import Iterable, Sequence
from math import isfinite, nan
from typing import Final

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
