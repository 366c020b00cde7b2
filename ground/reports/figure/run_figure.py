"""Put the map and the plots of a run on one figure, and write it to a file."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from ground.map.scene import Shape
from ground.recording.tables.series import RunSeries
from ground.reports.figure.map_axes import draw_map
from ground.reports.figure.style import INK, SOFT, Style
from ground.reports.figure.time_axes import MARKS, PLOTS, draw_over_time
from runtime.errors import UserError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UNDATED: Final = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}, ".png": {}}
"""Metadata for each suffix of a file, without the time of drawing."""
COLUMN_SPARE_IN: Final = 0.9
"""Height around the map in one column, for its labels and legend."""
PLOT_IN: Final = 1.0


class Run(NamedTuple):
    """All that a figure shows."""

    series: RunSeries
    facts: dict[str, Any]
    fence: Shape | None
    title: str
    source: str


def write(path: Path, run: Run, style: Style) -> None:
    """Write a PNG, SVG or PDF by the suffix of the path. UserError when matplotlib is missing."""
    try:
        from matplotlib import rc_context  # slow, and wanted only here
        from matplotlib.figure import Figure
    except ImportError:
        fix = "pip install 'sidestep[study]'"
        raise UserError(f"a plot needs matplotlib, which is not installed: {fix}") from None
    settings: Any = style.settings
    with rc_context(settings):
        size_in = (style.width_in, height_in(style, run.facts))
        figure = Figure(figsize=size_in, layout="constrained", dpi=style.dpi)
        place, plots = axes_of(figure, style, run.facts)
        draw_map(place, run.series, run.facts, run.fence)
        draw_over_time(plots, run.series)
        explain(figure, place, plots, run, style)
        figure.savefig(path, metadata=UNDATED[path.suffix])


def height_in(style: Style, facts: dict[str, Any]) -> float:
    """Return the height in inches; in one column that of the map follows its world."""
    if not style.one_column:
        return style.height_in
    return map_height_in(style, facts) + PLOTS * PLOT_IN


def map_height_in(style: Style, facts: dict[str, Any]) -> float:
    """Return the height in inches of the map in one column."""
    wide_m, high_m = facts.get("size_m", (1.0, 1.0))
    return style.width_in * min(2.0, float(high_m) / float(wide_m)) + COLUMN_SPARE_IN


def axes_of(figure: "Figure", style: Style, facts: dict[str, Any]) -> "tuple[Axes, list[Axes]]":
    """Return the axes of the map and those over time, which share their time."""
    if style.one_column:
        heights = (map_height_in(style, facts), *(PLOT_IN for _ in range(PLOTS)))
        grid = figure.add_gridspec(PLOTS + 1, 1, height_ratios=heights)
        place = figure.add_subplot(grid[0, 0])
        cells = [grid[row, 0] for row in range(1, PLOTS + 1)]
    else:
        grid = figure.add_gridspec(PLOTS, 2, width_ratios=(1.35, 1.0))
        place = figure.add_subplot(grid[:, 0])
        cells = [grid[row, 1] for row in range(PLOTS)]
    plots = [figure.add_subplot(cells[0])]
    plots += [figure.add_subplot(cell, sharex=plots[0]) for cell in cells[1:]]
    return place, plots


def explain(
    figure: "Figure", place: "Axes", plots: "Sequence[Axes]", run: Run, style: Style
) -> None:
    """Add legends outside the data, the meaning of the events, and a title."""
    legend_above(place, 2 if style.one_column else 4)
    for axes in plots:
        legend_above(axes, 3)
    explain_events(figure, run.series)
    if not style.one_column:
        figure.suptitle(run.title, color=INK)
        figure.text(0.995, 0.005, run.source, ha="right", color=SOFT, fontsize=style.font_pt - 2)


def legend_above(axes: "Axes", columns: int) -> None:
    """Put the legend above its axes, where no data is."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncols=columns,
            frameon=False,
            borderaxespad=0.0,
            handlelength=1.6,
        )


def explain_events(figure: "Figure", series: RunSeries) -> None:
    """Say below all plots what the vertical lines mean, for the kinds that occur."""
    from matplotlib.lines import Line2D

    kinds = dict.fromkeys(mark.kind for mark in series.marks if mark.kind in MARKS)
    handles = [
        Line2D([], [], color=colour, linestyle=":", label=words)
        for colour, words in (MARKS[kind] for kind in kinds)
    ]
    if handles:
        figure.legend(handles=handles, loc="outside lower left", ncols=4, frameon=False)
