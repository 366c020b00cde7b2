"""Plots of results with matplotlib, which is in the extra `study`."""

from io import BytesIO
from math import hypot, inf, nan, sqrt
from typing import TYPE_CHECKING, Any

from ground.commands.plot import fence_in, title_of
from ground.recording.figure import RULE, TRUE, FigureContents, drawn
from ground.recording.log_reader import Log, open_log
from ground.recording.tables import RunSeries, TimeAxis, collect_series
from protocol.ring import RADIUS_M
from protocol.world import World
from runtime.errors import UserError
from sidestep.table import Table

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure


def plot_trial(world: World, trace: Table, title: str) -> "Figure":
    """Draw the map of a trial, and ranges, speeds and position error over time."""
    goal = world.goal
    heading_rad = nan if goal.heading_rad is None else goal.heading_rad
    run = RunSeries(goals=[(goal.x_m, goal.y_m, heading_rad)])
    for tick in trace:
        row: dict[str, Any] = {
            name: nan if value is None else value for name, value in tick.items()
        }
        time_s = row["time_s"]
        run.true.append((row["true_x_m"], row["true_y_m"], row["true_heading_rad"]))
        run.estimated.append((row["x_m"], row["y_m"], row["heading_rad"]))
        run.covariances.append((row["cov_xx_m2"], row["cov_xy_m2"], row["cov_yy_m2"]))
        nearest_m = row["nearest_range_m"]
        run.nearest_m.add(time_s, nan if nearest_m == inf else nearest_m)
        run.speed_m_s.add(time_s, row["speed_m_s"])
        run.commanded_m_s.add(time_s, row["wanted_speed_m_s"])
        run.yaw_rate_rad_s.add(time_s, row["yaw_rate_rad_s"])
        variance_m2 = row["cov_xx_m2"] + row["cov_yy_m2"]
        run.sigma_m.add(time_s, sqrt(variance_m2) if variance_m2 >= 0.0 else nan)
        error_m = hypot(row["true_x_m"] - row["x_m"], row["true_y_m"] - row["y_m"])
        run.error_m.add(time_s, error_m)
    return figure_of(FigureContents(run, world, (), title, ""))


def plot_recording(path: "Path", log: Log, world: World | None) -> "Figure":
    """Draw a recording, as `sidestep rec plot` does."""
    found = collect_series(TimeAxis(open_log(path)), RADIUS_M if world is None else world.radius_m)
    if not (found.estimated or found.true):
        raise UserError(f"{path}: has no pose, so there is nothing to draw")
    title = title_of(log.robot, world, found)
    return figure_of(FigureContents(found, world, fence_in(path), title, path.name))


def plot_study(summary: Table) -> "Figure":
    """Draw a bar for each row of a study's summary: the share of goals that were reached."""
    try:
        from matplotlib.figure import Figure  # slow import
    except ImportError:
        raise UserError("plot() needs matplotlib: pip install 'sidestep[study]'") from None
    rows: list[dict[str, Any]] = list(summary)[::-1]
    labels = [f"{row['navigator']}, {row['side']}, {row['noise']}" for row in rows]
    figure = Figure(figsize=(7.0, 1.0 + 0.35 * len(rows)), layout="constrained")
    axes = figure.add_subplot()
    axes.barh(labels, [100.0 * row["reached_share"] for row in rows], color=TRUE)
    for place, row in enumerate(rows):
        words = f" {row['reached']} of {row['trials']} in {row['worlds']} worlds"
        axes.text(0.0, place, words, va="center", color="white")
    axes.set(xlim=(0.0, 100.0), xlabel="reached without a contact (%)")
    axes.grid(color=RULE, linewidth=0.5, axis="x")
    axes.set_axisbelow(True)
    return shown(figure)


def figure_of(contents: FigureContents) -> "Figure":
    """Return the figure of a run."""
    with drawn(contents) as figure:
        return shown(figure)


def shown(figure: "Figure") -> "Figure":
    """Let a notebook show a figure; those of pyplot alone show themselves."""

    def png() -> bytes:
        written = BytesIO()
        figure.savefig(written, format="png")
        return written.getvalue()

    setattr(figure, "_repr_png_", png)  # noqa: B010 - mypy knows no such attribute
    return figure
