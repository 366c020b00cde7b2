"""Draw the path of a run over its world."""

from collections.abc import Iterable
from math import cos, degrees, isfinite, sin
from typing import TYPE_CHECKING, Any, Final

from ground.map.ellipse import OUTSIDE, ellipse
from ground.map.scene import Disc, Shape
from ground.recording.tables.series import Place, RunSeries
from ground.recording.world_metadata import discs, outlines
from ground.reports.figure.style import COOL, GOAL, INK, RULE, SOLID, TRUE, WARM

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ELLIPSES: Final = 8
MAX_ECHOES: Final = 4000
ARROW_M: Final = 0.25


def draw_map(axes: "Axes", run: RunSeries, facts: dict[str, Any], fence: Shape | None) -> None:
    """Draw the world in grey, the true path solid, the estimate dotted with its uncertainty."""
    draw_world(axes, facts)
    draw_fence(axes, fence)
    step = max(1, len(run.echoes) // MAX_ECHOES)
    _dots(axes, run.echoes[::step])
    _path(axes, run.true, "-", "true path", TRUE)
    _path(axes, run.estimated, ":" if run.true else "-", "estimated path", INK)
    draw_ellipses(axes, run)
    draw_goals(axes, run.goals)
    if run.estimated:
        axes.plot(*zip(run.estimated[0][:2], strict=True), "s", color=INK, ms=4, label="start")
    axes.set_aspect("equal", adjustable="datalim" if "size_m" not in facts else "box")
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


def draw_fence(axes: "Axes", fence: Shape | None) -> None:
    """Draw the fence that was in force at the end of the recording."""
    from matplotlib.patches import Circle, Polygon

    if fence is None:
        return
    look: dict[str, Any] = {"fill": False, "ec": WARM, "ls": "-.", "label": "fence"}
    if isinstance(fence, Disc):
        axes.add_patch(Circle((fence.x_m, fence.y_m), fence.radius_m, **look))
    else:
        axes.add_patch(Polygon(fence.points_m, **look))


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
