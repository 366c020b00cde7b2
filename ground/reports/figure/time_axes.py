"""Draw ranges, speeds and the position error of a run over time, one axis for each unit."""

from typing import TYPE_CHECKING, Final

from ground.recording.bookmarks import Mark
from ground.recording.tables.series import RunSeries, TimedValues
from ground.reports.figure.style import GOAL, INK, RULE, SOFT, SOLID, TRUE, WARM

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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


def draw_marks(axes: "Axes", marks: tuple[Mark, ...]) -> None:
    """Draw the events as vertical lines."""
    for mark in marks:
        colour, _ = MARKS.get(mark.kind, (SOFT, mark.kind))
        axes.axvline(mark.time_s, color=colour, linewidth=0.9, linestyle=":")


def _line(axes: "Axes", series: TimedValues, colour: str, label: str, style: str = "-") -> None:
    if series.times_s:
        axes.plot(series.times_s, series.values, style, color=colour, label=label)
