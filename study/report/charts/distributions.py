"""Figures of outcomes, errors, path lengths and decisions."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from study.report.charts.charts import bars, distribution_chart, success_chart
from study.report.page import Block, PageFigure, PageTable
from study.report.paper.targets import ERRORS, RATIO
from study.report.summary import Summary
from study.report.trials import Trials
from study.report.words import number, percent, share
from study.statistics.intervals import CONFIDENT, Floats, Share, quantile

ENDS: Final = {
    "reached": "o-reached",
    "collided": "o-collided",
    "unreachable": "o-unreachable",
    "lost": "o-lost",
    "stuck": "o-stuck",
    "timeout": "o-timeout",
    "aborted": "o-aborted",
    "failed": "o-other",
}
SPENT: Final = {
    "to goal": ("o-goal", "ticks_to_goal"),
    "passing left": ("o-left", "ticks_passing_left"),
    "passing right": ("o-right", "ticks_passing_right"),
    "aligning": ("o-align", "ticks_aligning"),
}


def success_figure(found: list[Summary]) -> PageFigure:
    """Return success by navigator and noise level."""
    panels: dict[str, dict[str, Share]] = {}
    for one in found:
        panels.setdefault(one.noise, {})[one.label] = one.success
    labels = list(dict.fromkeys(one.label for one in found))
    title = "Success by navigator and noise; the table below has the values"
    drawing = success_chart(panels, labels, title)
    caption = f"Success in percent, with {CONFIDENT} intervals, by noise."
    return PageFigure("success", drawing, caption)


def ends_figure(trials: Trials) -> PageFigure:
    """Return shares of outcomes by navigator and noise level."""
    rows: dict[str, Mapping[str, float]] = {}
    for label in trials.labels():
        for noise in trials.values("noise"):
            some = trials.where(trials.possible).of(label=label, noise=noise)
            if len(some):
                rows[f"{label} / {noise}"] = {
                    end: some.count(some.has(outcome=end)) / len(some) for end in ENDS
                }
    used = {end: kind for end, kind in ENDS.items() if any(row[end] for row in rows.values())}
    title = "Outcomes as shares of trials in worlds with a path, by navigator and noise"
    caption = "Outcomes in worlds with a path to the goal, by navigator and noise."
    return PageFigure("ends", bars(rows, used, title), caption)


def error_figure(trials: Trials) -> PageFigure:
    """Return the distribution of the true position error of arrivals."""
    lines = {noise: (most_m,) for noise, most_m, _ in ERRORS}
    panels = _panels(trials, lambda some: some.numbers("position_error_m"))
    title = "Distribution of the true position error of arrivals, by navigator and noise"
    x_title, ends = "true position error, m", (0.002, 5.0)
    drawing = distribution_chart(panels, title, x_title, ends, lambda noise: lines.get(noise, ()))
    caption = (
        "Share of arrivals whose true distance from the goal is at most this large. Dotted: the "
        "wanted limit."
    )
    return PageFigure("position-error", drawing, caption)


def ratio_figure(trials: Trials) -> PageFigure:
    """Return the distribution of path length over the shortest one."""
    panels = _panels(trials, lambda some: some.ratio)
    title = "Distribution of path length over the shortest one, by navigator and noise"
    limits = [most for _, _, most in RATIO]
    drawing = distribution_chart(
        panels, title, "path / shortest path", (1.0, 20.0), lambda _: limits
    )
    caption = (
        "Share of arrivals whose path is at most this many times the shortest. Dotted: the wanted "
        "limits of the median and of the 90th percentile."
    )
    return PageFigure("path-ratio", drawing, caption)


def _panels(trials: Trials, values: Callable[[Trials], Floats]) -> dict[str, dict[str, Floats]]:
    arrivals = trials.where(trials.arrived & trials.possible)
    return {
        noise: {label: values(arrivals.of(noise=noise, label=label)) for label in trials.labels()}
        for noise in trials.values("noise")
    }


def error_table(trials: Trials) -> PageTable:
    """Return the final pose errors of arrivals against the robot's own covariance."""
    rows = []
    for label in trials.labels():
        for noise in trials.values("noise"):
            some = trials.of(label=label, noise=noise)
            arrivals = some.where(some.arrived & some.possible)
            if len(arrivals):
                rows.append((label, noise, str(len(arrivals)), *_errors(arrivals)))
    head = (
        *("navigator", "noise", "arrivals", "position error m: 50 %", "90 %", "99 %", "100 %"),
        *("heading error deg: 50 %", "95 %"),
        *(f"in own {CONFIDENT} ellipse", "mean squared Mahalanobis"),
    )
    caption = (
        f"Final pose of arrivals. A consistent covariance has {CONFIDENT} inside its ellipse "
        "and a mean squared Mahalanobis distance of 2."
    )
    return PageTable(caption, head, tuple(rows), names=2)


def _errors(arrivals: Trials) -> tuple[str, ...]:
    error_m = arrivals.numbers("position_error_m")
    heading_deg = np.degrees(arrivals.numbers("heading_error_rad"))
    squared = arrivals.numbers("mahalanobis2")
    squared = squared[np.isfinite(squared)]
    known = arrivals.where(np.isfinite(arrivals.numbers("mahalanobis2")))
    return (
        *(number(quantile(error_m, at), 3) for at in (0.5, 0.9, 0.99, 1.0)),
        *(number(quantile(heading_deg, at), 1) for at in (0.5, 0.95)),
        share(Share(known.count(known.inside), len(known))),
        number(float(squared.mean()) if len(squared) else np.nan),
    )


def spent_figure(trials: Trials) -> PageFigure:
    """Return the shares of ticks per decision."""
    rows: dict[str, Mapping[str, float]] = {}
    for label in trials.labels():
        some = trials.of(label=label)
        sums = {part: float(np.nansum(some.numbers(name))) for part, (_, name) in SPENT.items()}
        total = sum(sums.values())
        if total:
            rows[label] = {part: value / total for part, value in sums.items()}
    kinds = {part: kind for part, (kind, _) in SPENT.items()}
    title = "Decisions of the robot as shares of its ticks, by navigator"
    return PageFigure("decisions", bars(rows, kinds, title), "Decisions as shares of all ticks.")


def behaviour_blocks(trials: Trials) -> tuple[Block, ...]:
    """Return figure and table of driving behaviour."""
    rows = []
    for label in trials.labels():
        some = trials.of(label=label)
        changes, avoided = some.numbers("side_changes"), some.numbers("avoidances")
        rows.append(
            (
                label,
                *(f"{quantile(avoided, at):.0f}" if len(some) else "-" for at in (0.5, 1.0)),
                *(number(quantile(changes, at), 0) for at in (0.5, 0.95, 1.0)),
                percent(some.count(changes > 4.0) / len(some)),
                number(quantile(some.numbers("turned_rad"), 0.5), 1),
                number(quantile(some.numbers("mean_clearance_m"), 0.5)),
            )
        )
    head = (
        *("navigator", "avoidances: median", "worst", "side changes: median", "95 %", "worst"),
        *("more than 4 changes %", "turned rad, median", "mean clearance m, median"),
    )
    caption = "Behaviour over all trials: how often avoiding began, and how often the side changed."
    return spent_figure(trials), PageTable(caption, head, tuple(rows))
