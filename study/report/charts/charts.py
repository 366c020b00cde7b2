"""Charts of success with intervals, of distributions, and of shares."""

from collections.abc import Callable, Mapping, Sequence
from math import floor, isfinite, log10
from typing import Final

import numpy as np

from study.report.charts.style import colour, dashed
from study.report.charts.svg import SvgDrawing
from study.statistics.intervals import Floats, Share

NAMES: Final = 118.0
PANEL: Final = 210.0
GAP: Final = 34.0
ROW: Final = 22.0
TOP: Final = 26.0
MAX_DOTS: Final = 80

Panels = Mapping[str, Mapping[str, Share]]


def success_chart(panels: Panels, labels: Sequence[str], alt_text: str) -> SvgDrawing:
    """Draw a panel per noise level, a row per navigator: rate and interval from 0 to 100 %."""
    height = TOP + ROW * len(labels) + 24.0
    drawing = SvgDrawing(NAMES + (PANEL + GAP) * len(panels), height, alt_text)
    for row, label in enumerate(labels):
        drawing.text((NAMES - 10, _row(row) + 4), label, anchor="end")
    for column, (title, panel) in enumerate(panels.items()):
        left = NAMES + column * (PANEL + GAP)
        drawing.text((left, 14), title, "head")
        for percent in (0, 25, 50, 75, 100):
            x = left + PANEL * percent / 100
            drawing.line((x, TOP), (x, height - 20), "grid")
            drawing.text((x, height - 6), f"{percent}", "small", "middle")
        for row, label in enumerate(labels):
            if label in panel and panel[label].of:
                _whisker(drawing, left, _row(row), label, panel[label])
    return drawing


def _row(row: int) -> float:
    return TOP + ROW * (row + 0.5)


def _whisker(drawing: SvgDrawing, left: float, y: float, label: str, found: Share) -> None:
    low, high = found.interval
    ends = (left + PANEL * low, y), (left + PANEL * high, y)
    drawing.line(*ends, f"whisker l-{colour(label)}")
    drawing.circle((left + PANEL * found.rate, y), 4.0, f"mark f-{colour(label)}")


def bars(
    rows: Mapping[str, Mapping[str, float]], kinds: Mapping[str, str], alt_text: str
) -> SvgDrawing:
    """Draw a bar per row of shares that add up to 1; `kinds` are the class names of the parts."""
    names, width = 200.0, 560.0
    drawing = SvgDrawing(names + width + 12, TOP + 19.0 * len(rows) + 6, alt_text)
    x = names
    for part, kind in kinds.items():
        drawing.rectangle((x, 4), 11, 11, kind)
        drawing.text((x + 15, 13.5), part, "small")
        x += 30 + 6.2 * len(part)
    for row, (label, parts) in enumerate(rows.items()):
        y, x = TOP + 19.0 * row, names
        drawing.text((names - 10, y + 11), label, anchor="end")
        for part, kind in kinds.items():
            wide = width * parts.get(part, 0.0)
            if wide <= 0.0:
                continue
            drawing.rectangle((x, y), wide, 15, kind)
            if wide > 34:
                drawing.text((x + wide / 2, y + 11), f"{parts[part]:.0%}", "on", "middle")
            x += wide
    return drawing


def distribution_chart(
    panels: Mapping[str, Mapping[str, Floats]],
    alt_text: str,
    x_title: str,
    ends: tuple[float, float],
    wanted: Callable[[str], Sequence[float]] = lambda _: (),
) -> SvgDrawing:
    """Draw cumulative distributions on a logarithmic axis, a panel per noise level.

    `wanted` gives the values at which a panel has a dotted line.
    """
    labels = list(dict.fromkeys(label for panel in panels.values() for label in panel))
    high, across, left = 150.0, min(4, max(1, len(panels))), 40.0
    down = -(-len(panels) // across)
    legend = 22.0
    drawing = SvgDrawing(left + (PANEL + GAP) * across, legend + (high + 62) * down, alt_text)
    _legend(drawing, labels, left)
    for place, (title, panel) in enumerate(panels.items()):
        corner = (
            left + (place % across) * (PANEL + GAP),
            legend + 24 + (place // across) * (high + 62),
        )
        _frame(drawing, corner, high, title, x_title, ends, place % across == 0)
        for value in wanted(title):
            x = corner[0] + PANEL * _along(value, ends)
            drawing.line((x, corner[1]), (x, corner[1] + high), "wanted")
        for label, values in panel.items():
            dots = [
                (corner[0] + PANEL * _along(value, ends), corner[1] + high * (1 - share))
                for value, share in steps(values)
            ]
            if dots:
                drawing.polyline(dots, f"way l-{colour(label)}{dashed(label)}")
    return drawing


def steps(values: Floats) -> list[tuple[float, float]]:
    """Return the distribution as at most `MAX_DOTS` points."""
    found = np.sort(values[np.isfinite(values)])
    if not len(found):
        return []
    shares = np.linspace(0.0, 1.0, min(MAX_DOTS, len(found) + 1))
    return list(zip(np.quantile(found, shares).tolist(), shares.tolist(), strict=True))


def _legend(drawing: SvgDrawing, labels: Sequence[str], left: float) -> None:
    x = left
    for label in labels:
        drawing.line((x, 9), (x + 20, 9), f"way l-{colour(label)}{dashed(label)}")
        drawing.text((x + 25, 13), label, "small")
        x += 44 + 6.2 * len(label)


def _frame(
    drawing: SvgDrawing,
    corner: tuple[float, float],
    high: float,
    title: str,
    x_title: str,
    ends: tuple[float, float],
    first: bool,
) -> None:
    left, top = corner
    drawing.text((left, top - 8), title, "head")
    for percent in (0, 25, 50, 75, 100):
        y = top + high * (1 - percent / 100)
        drawing.line((left, y), (left + PANEL, y), "grid")
        if first:
            drawing.text((left - 6, y + 3.5), f"{percent} %", "small", "end")
    for tick in _ticks(ends):
        x = left + PANEL * _along(tick, ends)
        drawing.line((x, top), (x, top + high), "grid")
        drawing.text((x, top + high + 13), f"{tick:g}", "small", "middle")
    drawing.text((left + PANEL / 2, top + high + 28), x_title, "small", "middle")


def _ticks(ends: tuple[float, float]) -> list[float]:
    found = [
        factor * 10.0**power
        for power in range(floor(log10(ends[0])), floor(log10(ends[1])) + 1)
        for factor in ((1.0,) if ends[1] / ends[0] > 500.0 else (1.0, 2.0, 5.0))
    ]
    return [round(tick, 6) for tick in found if ends[0] * 0.999 <= tick <= ends[1] * 1.001]


def _along(value: float, ends: tuple[float, float]) -> float:
    """Return the position on the axis from 0 to 1; values beyond an end are drawn at it."""
    low, high = ends
    held = min(max(value, low), high) if isfinite(value) else high
    return (log10(held) - log10(low)) / (log10(high) - log10(low))
