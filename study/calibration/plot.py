"""Plot the return errors of both directions before and after, with their centres of gravity."""

from collections.abc import Sequence
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ground.reports.figure.style import INK, RULE, SOFT, TRUE, WARM
from robot.core.parameters import Params
from study.calibration.result import CalibrationResult
from study.calibration.runs import CCW, CW, SquareRun, errors_of
from study.calibration.umbmark import Umbmark

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOOKS: Final = {CW: ("o", TRUE, "clockwise"), CCW: ("s", WARM, "counter-clockwise")}
"""Marker, colour and name of each direction."""


def write(path: Path, result: CalibrationResult) -> None:
    """Write an SVG or PNG file; raise OSError, or ValueError for another suffix."""
    from matplotlib.figure import Figure  # slow import, needed only here

    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    panels = figure.subplots(1, 2)
    runs = ((result.first, result.before), (result.second, result.after))
    most_m = max(farthest_m(some, params) for some, params in runs)
    for axes, name, (some, params), mark in zip(
        panels, ("before", "after"), runs, result.marks(), strict=True
    ):
        draw(axes, some, params, mark)
        axes.set_title(f"{name}: E_max,syst {1000.0 * mark.largest_m:.1f} mm", color=INK)
        axes.set(xlim=(-1.1 * most_m, 1.1 * most_m), ylim=(-1.1 * most_m, 1.1 * most_m))
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    figure.suptitle(f"Return errors: {result.source}", color=INK)
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


def farthest_m(runs: Sequence[SquareRun], params: Params) -> float:
    """Return the largest coordinate of a return error."""
    return float(abs(errors_of(runs, params)[:, :2]).max())


def draw(axes: "Axes", runs: Sequence[SquareRun], params: Params, mark: Umbmark) -> None:
    """Draw each run, an arrow to the centre of each direction, and the circle of E_max,syst."""
    from matplotlib.patches import Circle

    for direction, centre_m in ((CW, mark.cw_m), (CCW, mark.ccw_m)):
        shape, colour, name = LOOKS[direction]
        errors = errors_of([run for run in runs if run.direction == direction], params)
        axes.scatter(errors[:, 0], errors[:, 1], s=14, marker=shape, color=colour, label=name)
        if hypot(*centre_m) > 0.0:
            arrow = {"arrowstyle": "-|>", "color": colour, "shrinkA": 0.0, "shrinkB": 0.0}
            axes.annotate("", centre_m, (0.0, 0.0), arrowprops=arrow)
    limit = Circle((0.0, 0.0), mark.largest_m, fill=False, ec=INK, ls="--", label="E_max,syst")
    axes.add_patch(limit)
    axes.axhline(0.0, color=SOFT, linewidth=0.6)
    axes.axvline(0.0, color=SOFT, linewidth=0.6)
    axes.grid(color=RULE, linewidth=0.5)
    axes.set_axisbelow(True)
    axes.set(xlabel="return error x (m)", ylabel="return error y (m)")
    axes.set_aspect("equal", adjustable="box")
