"""A run as a picture: its way over the world, and ranges, speeds and uncertainty over time."""

from collections.abc import Iterable
from math import cos, degrees, isfinite, sin
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ground.map.ellipse import ellipse
from ground.recording.tables.series import Place, Run, Series
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
MOST_ECHOES: Final = 4000
SIZE_INCHES: Final = (12.0, 7.0)
DPI: Final = 120


def write(path: Path, run: Run, facts: dict[str, Any], title: str) -> None:
    """A PNG or SVG, by its name. UserError when matplotlib is not there or knows no such kind."""
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
    draw_doubts(doubts, run)
    for axes in (ranges, speeds, doubts):
        draw_marks(axes, run)
    figure.suptitle(title, fontsize=11, color=INK)
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


def draw_map(axes: "Axes", run: Run, facts: dict[str, Any]) -> None:
    """The world in grey, the true way solid, the believed one dotted, with what it doubted."""
    draw_world(axes, facts)
    step = max(1, len(run.echoes) // MOST_ECHOES)
    _dots(axes, run.echoes[::step])
    _way(axes, run.true, "-", "true way", TRUE)
    _way(axes, run.believed, ":" if run.true else "-", "believed", INK)
    draw_ellipses(axes, run)
    for x_m, y_m, heading_rad in run.goals:
        axes.plot([x_m], [y_m], "o", mfc="none", mec=GOAL, ms=11, mew=1.6)
        if isfinite(heading_rad):
            end = (x_m + 0.25 * cos(heading_rad), y_m + 0.25 * sin(heading_rad))
            axes.annotate("", end, (x_m, y_m), arrowprops={"arrowstyle": "->", "color": GOAL})
    if run.believed:
        axes.plot(*zip(run.believed[0][:2], strict=True), "s", color=INK, ms=5, label="start")
    axes.set_aspect("equal", adjustable="datalim" if "size_m" not in facts else "box")
    axes.set(xlabel="x, m", ylabel="y, m")
    axes.grid(color=RULE, linewidth=0.5)
    axes.set_axisbelow(True)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, fontsize=8)


def draw_world(axes: "Axes", facts: dict[str, Any]) -> None:
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
    """Is this the outer wall, which is drawn and not filled?"""
    return bool(facts.get("walls")) and points[2] == tuple(facts.get("size_m", ()))


def draw_ellipses(axes: "Axes", run: Run) -> None:
    """Draw the ellipses that contain the true position with probability 1 - `ellipse.OUTSIDE`."""
    from matplotlib.patches import Ellipse

    step = max(1, len(run.believed) // ELLIPSES)
    for (x_m, y_m, _), covariance in zip(
        run.believed[::step], run.covariances[::step], strict=True
    ):
        if (axes_of := ellipse(covariance)) is None:
            continue
        long_m, short_m, turned_rad = axes_of
        size_m, turned_deg = (2.0 * long_m, 2.0 * short_m), degrees(turned_rad)
        axes.add_patch(Ellipse((x_m, y_m), *size_m, angle=turned_deg, fill=False, ec=INK, lw=0.8))


def draw_ranges(axes: "Axes", run: Run) -> None:
    _line(axes, run.nearest_m, TRUE, "nearest echo")
    _line(axes, run.zone_m, WARM, "avoidance zone", "--")
    _finish(axes, "range, m")


def draw_speeds(axes: "Axes", run: Run) -> None:
    _line(axes, run.wanted_m_s, SOLID, "wanted, m/s")
    _line(axes, run.speed_m_s, TRUE, "driven, m/s")
    _line(axes, run.yaw_rate_rad_s, COOL, "turning, rad/s", linewidth=0.8)
    _finish(axes, "speed")


def draw_doubts(axes: "Axes", run: Run) -> None:
    _line(axes, run.sigma_m, TRUE, "claimed (1 sigma)")
    _line(axes, run.error_m, WARM, "true error")
    _finish(axes, "place, m")
    axes.set_xlabel("time of the robot's stamps, s")


def draw_marks(axes: "Axes", run: Run) -> None:
    for mark in run.marks:
        axes.axvline(mark.time_s, color=KINDS.get(mark.kind, SOFT), linewidth=0.9, linestyle=":")


def _line(
    axes: "Axes", series: Series, colour: str, label: str, style: str = "-", linewidth: float = 1.2
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


def _way(axes: "Axes", places: list[Place], style: str, label: str, colour: str) -> None:
    if places:
        xs_m, ys_m, _ = zip(*places, strict=True)
        axes.plot(xs_m, ys_m, style, color=colour, label=label, linewidth=1.6)


def _dots(axes: "Axes", points: Iterable[tuple[float, float]]) -> None:
    found = list(points)
    if found:
        axes.plot(*zip(*found, strict=True), ".", color=COOL, ms=1.5, alpha=0.35, label="echoes")
