"""Draw a run: its path over the world, and ranges, speeds and uncertainty over time."""

from collections.abc import Iterable
from math import cos, degrees, isfinite, sin
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ground.map.ellipse import ellipse
from ground.recording.tables.series import Place, RunSeries, TimedValues
from ground.recording.world_metadata import discs, outlines
from runtime.errors import UserError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK: Final = "#1c1e21"
SOFT: Final = "#5d636b"
RULE: Final = "#d5d9de"
SOLID: Final = "#9aa1aa"
TRUE: Final = "#0054a6"
GOAL: Final = "#009e73"
WARM: Final = "#d55e00"
COOL: Final = "#3a9bd9"
KINDS: Final = {"goal": GOAL, "outcome": INK, "failsafe": WARM, "mark": TRUE}
ELLIPSES: Final = 8
MAX_ECHOES: Final = 4000
SIZE_INCHES: Final = (12.0, 7.0)
DPI: Final = 120


def write(path: Path, run: RunSeries, facts: dict[str, Any], title: str) -> None:
    """Write a PNG or SVG. UserError when matplotlib is missing or rejects the file's suffix."""
    try:
        from matplotlib.figure import Figure  # slow, and wanted only here
    except ImportError:
        fix = "pip install 'sidestep[study]'"
        raise UserError(f"a plot needs matplotlib, which is not installed: {fix}") from None
    figure = Figure(figsize=SIZE_INCHES, layout="constrained", dpi=DPI)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.35, 1.0))
    ranges = figure.add_subplot(grid[0, 1])
    speeds = figure.add_subplot(grid[1, 1], sharex=ranges)
    doubts = figure.add_subplot(grid[2, 1], sharex=ranges)
    draw_map(figure.add_subplot(grid[:, 0]), run, facts)
    draw_ranges(ranges, run)
    draw_speeds(speeds, run)
    draw_uncertainty(doubts, run)
    for axes in (ranges, speeds, doubts):
        draw_marks(axes, run)
    figure.suptitle(title, fontsize=11, color=INK)
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


def draw_map(axes: "Axes", run: RunSeries, facts: dict[str, Any]) -> None:
    """Draw the world in grey, the true path solid, the estimate dotted with its uncertainty."""
    draw_world(axes, facts)
    step = max(1, len(run.echoes) // MAX_ECHOES)
    _dots(axes, run.echoes[::step])
    _path(axes, run.true, "-", "true path", TRUE)
    _path(axes, run.estimated, ":" if run.true else "-", "estimated path", INK)
    draw_ellipses(axes, run)
    for x_m, y_m, heading_rad in run.goals:
        axes.plot([x_m], [y_m], "o", mfc="none", mec=GOAL, ms=11, mew=1.6)
        if isfinite(heading_rad):
            end = (x_m + 0.25 * cos(heading_rad), y_m + 0.25 * sin(heading_rad))
            axes.annotate("", end, (x_m, y_m), arrowprops={"arrowstyle": "->", "color": GOAL})
    if run.estimated:
        axes.plot(*zip(run.estimated[0][:2], strict=True), "s", color=INK, ms=5, label="start")
    axes.set_aspect("equal", adjustable="datalim" if "size_m" not in facts else "box")
    axes.set(xlabel="x, m", ylabel="y, m")
    axes.grid(color=RULE, linewidth=0.5)
    axes.set_axisbelow(True)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, fontsize=8)


def draw_world(axes: "Axes", facts: dict[str, Any]) -> None:
    """Draw walls and obstacles; a dashed line is the path of a moving one."""
    from matplotlib.patches import Circle

    for points, thickness_m in outlines(facts):
        closed = len(points) > 2 and points[0] == points[-1]
        if closed and thickness_m and len(points) > 3 and not _rim(points, facts):
            axes.fill(*zip(*points, strict=True), color=SOLID, linewidth=0.8)
        else:
            axes.plot(*zip(*points, strict=True), color=SOLID, linewidth=1.8)
    for centre, radius_m, path in discs(facts):
        axes.add_patch(Circle(centre, radius_m, color=SOLID, alpha=0.4 if path else 1.0))
        if path:
            axes.plot(*zip(*path, strict=True), color=SOLID, linewidth=0.9, linestyle="--")


def _rim(points: list[tuple[float, float]], facts: dict[str, Any]) -> bool:
    """Return whether this is the outer wall, which is drawn but not filled."""
    return bool(facts.get("walls")) and points[2] == tuple(facts.get("size_m", ()))


def draw_ellipses(axes: "Axes", run: RunSeries) -> None:
    """Draw the ellipses that contain the true position with probability 1 - `ellipse.OUTSIDE`."""
    from matplotlib.patches import Ellipse

    step = max(1, len(run.estimated) // ELLIPSES)
    for (x_m, y_m, _), covariance in zip(
        run.estimated[::step], run.covariances[::step], strict=True
    ):
        if (axes_of := ellipse(covariance)) is None:
            continue
        long_m, short_m, turned_rad = axes_of
        size_m, turned_deg = (2.0 * long_m, 2.0 * short_m), degrees(turned_rad)
        axes.add_patch(Ellipse((x_m, y_m), *size_m, angle=turned_deg, fill=False, ec=INK, lw=0.8))


def draw_ranges(axes: "Axes", run: RunSeries) -> None:
    """Draw the nearest echo and the avoidance zone."""
    _line(axes, run.nearest_m, TRUE, "nearest echo")
    _line(axes, run.zone_m, WARM, "avoidance zone", "--")
    _finish(axes, "range, m")


def draw_speeds(axes: "Axes", run: RunSeries) -> None:
    """Draw commanded and driven speeds."""
    _line(axes, run.commanded_m_s, SOLID, "commanded, m/s")
    _line(axes, run.speed_m_s, TRUE, "driven, m/s")
    _line(axes, run.yaw_rate_rad_s, COOL, "turning, rad/s", linewidth=0.8)
    _finish(axes, "speed")


def draw_uncertainty(axes: "Axes", run: RunSeries) -> None:
    """Draw the estimated uncertainty and the true error of the position."""
    _line(axes, run.sigma_m, TRUE, "estimated (1 sigma)")
    _line(axes, run.error_m, WARM, "true error")
    _finish(axes, "position error, m")
    axes.set_xlabel("robot time, s")


def draw_marks(axes: "Axes", run: RunSeries) -> None:
    """Draw the bookmarks as vertical lines."""
    for mark in run.marks:
        axes.axvline(mark.time_s, color=KINDS.get(mark.kind, SOFT), linewidth=0.9, linestyle=":")


def _line(
    axes: "Axes",
    series: TimedValues,
    colour: str,
    label: str,
    style: str = "-",
    linewidth: float = 1.2,
) -> None:
    if series.times_s:
        axes.plot(
            series.times_s, series.values, style, color=colour, label=label, linewidth=linewidth
        )


def _finish(axes: "Axes", what: str) -> None:
    axes.set_ylabel(what)
    axes.grid(color=RULE, linewidth=0.5)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left", fontsize=7, framealpha=0.8)


def _path(axes: "Axes", places: list[Place], style: str, label: str, colour: str) -> None:
    if places:
        xs_m, ys_m, _ = zip(*places, strict=True)
        axes.plot(xs_m, ys_m, style, color=colour, label=label, linewidth=1.6)


def _dots(axes: "Axes", points: Iterable[tuple[float, float]]) -> None:
    found = list(points)
    if found:
        axes.plot(*zip(*found, strict=True), ".", color=COOL, ms=1.5, alpha=0.35, label="echoes")
