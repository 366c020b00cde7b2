"""Draw the map of a run and its ranges, speeds and position error over time on one figure.

There are sizes and colours for the screen, and for a column of a paper. Plots have one axis for
each unit.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import cos, degrees, isfinite, sin
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from ground.map.pen import ellipse
from ground.map.scene import Disc, Shape
from ground.recording.summary import Bookmark
from ground.recording.tables import Place, RunSeries, TimedValues
from ground.recording.world_metadata import discs, outlines
from protocol.outcome import OUTSIDE
from protocol.world import World
from runtime.errors import UserError
from runtime.files import drafted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


INK: Final = "#1c1e21"
SOFT: Final = "#5d636b"
RULE: Final = "#d5d9de"
SOLID: Final = "#9aa1aa"
TRUE: Final = "#0054a6"
GOAL: Final = "#009e73"
WARM: Final = "#d55e00"
COOL: Final = "#3a9bd9"


@dataclass(frozen=True, slots=True)
class Style:
    """The size of a figure in inches, its fonts in points, and the weight of its lines.

    `one_column`: the parts are below each other, without a title, which the paper's caption has.
    """

    name: str
    width_in: float
    height_in: float
    font_pt: float
    line_pt: float
    dpi: int
    one_column: bool = False

    @property
    def settings(self) -> Mapping[str, Any]:
        """The settings of matplotlib; text stays text, and equal runs give equal files."""
        return {
            "font.size": self.font_pt,
            "axes.linewidth": self.line_pt / 2.0,
            "xtick.major.width": self.line_pt / 2.0,
            "ytick.major.width": self.line_pt / 2.0,
            "lines.linewidth": self.line_pt,
            "pdf.fonttype": 42,
            "svg.hashsalt": "sidestep",
        }


SCREEN: Final = Style("screen", 12.0, 7.5, font_pt=9.0, line_pt=1.4, dpi=120)
PAPER: Final = Style("paper", 3.5, 7.0, font_pt=7.0, line_pt=0.9, dpi=300, one_column=True)
STYLES: Final = MappingProxyType({style.name: style for style in (SCREEN, PAPER)})

ELLIPSES: Final = 8
MAX_ECHOES: Final = 4000
ARROW_M: Final = 0.25


def draw_map(axes: "Axes", run: RunSeries, world: World | None, fence: Sequence[Shape]) -> None:
    """Draw the world in grey, the true path solid, the estimate dotted with its uncertainty."""
    if world is not None:
        draw_world(axes, world)
    draw_fence(axes, fence)
    step = max(1, len(run.echoes) // MAX_ECHOES)
    _dots(axes, run.echoes[::step])
    _path(axes, run.true, "-", "true path", TRUE)
    _path(axes, run.estimated, ":" if run.true else "-", "estimated path", INK)
    draw_ellipses(axes, run)
    draw_goals(axes, run.goals)
    if run.estimated:
        axes.plot(*zip(run.estimated[0][:2], strict=True), "s", color=INK, ms=4, label="start")
    axes.set_aspect("equal", adjustable="datalim" if world is None else "box")
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.grid(color=RULE, linewidth=0.5)
    axes.set_axisbelow(True)


def draw_goals(axes: "Axes", goals: list[Place]) -> None:
    """Draw a circle and the heading of each goal; several are numbered in their order."""
    for number, (x_m, y_m, heading_rad) in enumerate(goals, 1):
        label = "goal" if number == 1 else None
        axes.plot([x_m], [y_m], "o", mfc="none", mec=GOAL, ms=9, mew=1.4, ls="none", label=label)
        if len(goals) > 1:
            offset: dict[str, Any] = {"xytext": (6, 6), "textcoords": "offset points"}
            axes.annotate(str(number), (x_m, y_m), color=GOAL, weight="bold", **offset)
        if isfinite(heading_rad):
            end = (x_m + ARROW_M * cos(heading_rad), y_m + ARROW_M * sin(heading_rad))
            axes.annotate("", end, (x_m, y_m), arrowprops={"arrowstyle": "->", "color": GOAL})


def draw_fence(axes: "Axes", fence: Sequence[Shape]) -> None:
    """Draw the fence that was in force at the end of the recording."""
    from matplotlib.patches import Circle, Polygon

    look: dict[str, Any] = {"fill": False, "ec": WARM, "ls": "-.", "label": "fence"}
    for shape in fence:
        if isinstance(shape, Disc):
            axes.add_patch(Circle((shape.x_m, shape.y_m), shape.radius_m, **look))
        else:
            axes.add_patch(Polygon(shape.points_m, **look))
        look.pop("label", None)


def draw_world(axes: "Axes", world: World) -> None:
    """Draw walls and obstacles; a dashed line is the path of a moving one."""
    from matplotlib.patches import Circle

    for points, thickness_m in outlines(world):
        closed = len(points) > 2 and points[0] == points[-1]
        if closed and thickness_m and len(points) > 3 and not _rim(points, world):
            axes.fill(*zip(*points, strict=True), color=SOLID, linewidth=0.8)
        else:
            axes.plot(*zip(*points, strict=True), color=SOLID, linewidth=1.8)
    for one in discs(world):
        alpha = 0.4 if one.path_m else 1.0
        axes.add_patch(Circle((one.x_m, one.y_m), one.radius_m, color=SOLID, alpha=alpha))
        if one.path_m:
            axes.plot(*zip(*one.path_m, strict=True), color=SOLID, linewidth=0.9, linestyle="--")


def _rim(points: list[tuple[float, float]], world: World) -> bool:
    """Return whether this is the outer wall, which is drawn but not filled."""
    return world.walls and points[2] == world.size_m


def draw_ellipses(axes: "Axes", run: RunSeries) -> None:
    """Draw the ellipses that contain the true position with probability 1 - OUTSIDE."""
    from matplotlib.patches import Ellipse

    step = max(1, len(run.estimated) // ELLIPSES)
    label: str | None = f"{1.0 - OUTSIDE:.0%} ellipse of the estimate"
    for (x_m, y_m, _), covariance in zip(
        run.estimated[::step], run.covariances[::step], strict=True
    ):
        if (axes_of := ellipse(covariance)) is None:
            continue
        long_m, short_m, turned_rad = axes_of
        size_m, turned_deg = (2.0 * long_m, 2.0 * short_m), degrees(turned_rad)
        look: dict[str, Any] = {"fill": False, "ec": INK, "lw": 0.8, "label": label}
        axes.add_patch(Ellipse((x_m, y_m), *size_m, angle=turned_deg, **look))
        label = None


def _path(axes: "Axes", places: list[Place], style: str, label: str, colour: str) -> None:
    if places:
        xs_m, ys_m, _ = zip(*places, strict=True)
        axes.plot(xs_m, ys_m, style, color=colour, label=label)


def _dots(axes: "Axes", points: Iterable[tuple[float, float]]) -> None:
    found = list(points)
    if found:
        axes.plot(*zip(*found, strict=True), ".", color=COOL, ms=1.0, alpha=0.35, label="echoes")


UNDATED: Final = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}, ".png": {}}
"""Metadata for each suffix of a file, without the time of drawing."""
COLUMN_SPARE_IN: Final = 0.9
"""Height around the map in one column, for its labels and legend."""
PLOT_IN: Final = 1.0


class FigureContents(NamedTuple):
    """All that a figure shows."""

    series: RunSeries
    world: World | None
    fence: Sequence[Shape]
    title: str
    source: str


def write(path: Path, run: FigureContents, style: Style) -> None:
    """Write a PNG, SVG or PDF by the suffix of the path. UserError when matplotlib is missing."""
    with drawn(run, style) as figure, drafted(path) as draft:
        figure.savefig(draft, metadata=UNDATED[path.suffix])


@contextmanager
def drawn(run: FigureContents, style: Style = SCREEN) -> "Iterator[Figure]":
    """Yield the figure, with the settings of its style. UserError when matplotlib is missing."""
    try:
        from matplotlib import rc_context  # slow, and wanted only here
        from matplotlib.figure import Figure
    except ImportError:
        fix = "pip install 'sidestep[study]'"
        raise UserError(f"a plot needs matplotlib, which is not installed: {fix}") from None
    settings: Any = style.settings
    with rc_context(settings):
        size_in = (style.width_in, height_in(style, run.world))
        figure = Figure(figsize=size_in, layout="constrained", dpi=style.dpi)
        place, plots = axes_of(figure, style, run.world)
        draw_map(place, run.series, run.world, run.fence)
        draw_over_time(plots, run.series)
        explain(figure, place, plots, run, style)
        yield figure


def height_in(style: Style, world: World | None) -> float:
    """Return the height in inches; in one column that of the map follows its world."""
    if not style.one_column:
        return style.height_in
    return map_height_in(style, world) + PLOTS * PLOT_IN


def map_height_in(style: Style, world: World | None) -> float:
    """Return the height in inches of the map in one column."""
    wide_m, high_m = (1.0, 1.0) if world is None else world.size_m
    return style.width_in * min(2.0, high_m / wide_m) + COLUMN_SPARE_IN


def axes_of(figure: "Figure", style: Style, world: World | None) -> "tuple[Axes, list[Axes]]":
    """Return the axes of the map and those over time, which share their time."""
    if style.one_column:
        heights = (map_height_in(style, world), *(PLOT_IN for _ in range(PLOTS)))
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
    figure: "Figure", place: "Axes", plots: "Sequence[Axes]", run: FigureContents, style: Style
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


MARKS: Final = {
    "goal": (GOAL, "goal accepted"),
    "outcome": (INK, "end of a goal"),
    "failsafe": (WARM, "failsafe or stop"),
    "mark": (TRUE, "operator's mark"),
}
"""The colour and the meaning of each kind of event."""
PLOTS: Final = 4


def draw_over_time(plots: "list[Axes]", run: RunSeries) -> None:
    """Draw into PLOTS axes from top to bottom, with the events in each."""
    ranges, speeds, turns, errors = plots
    _line(ranges, run.nearest_m, TRUE, "nearest echo")
    _line(ranges, run.zone_m, WARM, "avoidance zone", "--")
    ranges.set_ylabel("range (m)")
    _line(speeds, run.commanded_m_s, SOLID, "commanded")
    _line(speeds, run.speed_m_s, TRUE, "driven")
    speeds.set_ylabel("speed (m/s)")
    _line(turns, run.yaw_rate_rad_s, TRUE, "turned")
    turns.set_ylabel("turning (rad/s)")
    _line(errors, run.sigma_m, TRUE, "estimated (1 sigma)")
    _line(errors, run.error_m, WARM, "true")
    errors.set_ylabel("position error (m)")
    errors.set_xlabel("time (s)")
    for axes in plots:
        axes.grid(color=RULE, linewidth=0.5)
        axes.tick_params(labelbottom=axes is errors)
        draw_marks(axes, run.marks)


def draw_marks(axes: "Axes", marks: tuple[Bookmark, ...]) -> None:
    """Draw the events as vertical lines."""
    for mark in marks:
        colour, _ = MARKS.get(mark.kind, (SOFT, mark.kind))
        axes.axvline(mark.time_s, color=colour, linewidth=0.9, linestyle=":")


def _line(axes: "Axes", series: TimedValues, colour: str, label: str, style: str = "-") -> None:
    if series.times_s:
        axes.plot(series.times_s, series.values, style, color=colour, label=label)
