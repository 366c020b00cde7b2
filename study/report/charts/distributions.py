"""Where drives end, how far off, how long their ways are, and what the robot decided meanwhile."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from study.report.charts.charts import bars, distribution_chart, success_chart
from study.report.page import Block, Figure, Table
from study.report.paper.targets import ERRORS, RATIO
from study.report.summary import Summary
from study.report.trials import Trials
from study.report.words import number, percent, share
from study.statistics.intervals import CONFIDENT, Floats, Share, quantile

ENDS: Final = {
    "reached": "o-reached",
    "collided": "o-collided",
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


def success_figure(found: list[Summary]) -> Figure:
    panels: dict[str, dict[str, Share]] = {}
    for one in found:
        panels.setdefault(one.noise, {})[one.label] = one.success
    labels = list(dict.fromkeys(one.label for one in found))
    says = "Success by navigator and noise; the table below has the values"
    drawing = success_chart(panels, labels, says)
    caption = f"Success in percent, with {CONFIDENT} intervals, by noise."
    return Figure("success", drawing, caption)


def ends_figure(trials: Trials) -> Figure:
    rows: dict[str, Mapping[str, float]] = {}
    for label in trials.labels():
        for noise in trials.values("noise"):
            some = trials.where(trials.possible).of(label=label, noise=noise)
            if len(some):
                rows[f"{label} / {noise}"] = {
                    end: some.count(some.has(outcome=end)) / len(some) for end in ENDS
                }
    used = {end: kind for end, kind in ENDS.items() if any(row[end] for row in rows.values())}
    says = "How drives end, as shares of trials in worlds with a way, by navigator and noise"
    caption = "How drives end in worlds with a way, by navigator and noise."
    return Figure("ends", bars(rows, used, says), caption)


def error_figure(trials: Trials) -> Figure:
    lines = {noise: (most_m,) for noise, most_m, _ in ERRORS}
    panels = _panels(trials, lambda some: some.numbers("position_error_m"))
    says = "Distribution of the true position error of arrivals, by navigator and noise"
    title, ends = "true position error, m", (0.002, 5.0)
    drawing = distribution_chart(panels, says, title, ends, lambda noise: lines.get(noise, ()))
    caption = (
        "Share of arrivals that stand at most so far from the goal in truth. Dotted: the limit "
        "that is wanted."
    )
    return Figure("position-error", drawing, caption)


def ratio_figure(trials: Trials) -> Figure:
    panels = _panels(trials, lambda some: some.ratio)
    says = "Distribution of the way driven over the shortest way, by navigator and noise"
    limits = [most for _, _, most in RATIO]
    drawing = distribution_chart(panels, says, "way / shortest way", (1.0, 20.0), lambda _: limits)
    caption = (
        "Share of arrivals whose way is at most so many times the shortest. Dotted: what is wanted "
        "of the median and of nine in ten."
    )
    return Figure("path-ratio", drawing, caption)


def _panels(trials: Trials, values: Callable[[Trials], Floats]) -> dict[str, dict[str, Floats]]:
    there = trials.where(trials.arrived & trials.possible)
    return {
        noise: {label: values(there.of(noise=noise, label=label)) for label in trials.labels()}
        for noise in trials.values("noise")
    }


def error_table(trials: Trials) -> Table:
    """Final pose of arrivals against what the robot said of its own doubt."""
    rows = []
    for label in trials.labels():
        for noise in trials.values("noise"):
            some = trials.of(label=label, noise=noise)
            there = some.where(some.arrived & some.possible)
            if len(there):
                rows.append((label, noise, str(len(there)), *_errors(there)))
    head = (
        *("navigator", "noise", "arrivals", "position error m: 50 %", "90 %", "99 %", "100 %"),
        *("heading error deg: 50 %", "95 %"),
        *(f"in own {CONFIDENT} ellipse", "mean squared Mahalanobis"),
    )
    caption = (
        f"Final pose of arrivals. An honest covariance has {CONFIDENT} inside its ellipse "
        "and a mean squared Mahalanobis distance of 2."
    )
    return Table(caption, head, tuple(rows), names=2)


def _errors(there: Trials) -> tuple[str, ...]:
    error_m = there.numbers("position_error_m")
    heading_deg = np.degrees(there.numbers("heading_error_rad"))
    squared = there.numbers("mahalanobis2")
    squared = squared[np.isfinite(squared)]
    known = there.where(np.isfinite(there.numbers("mahalanobis2")))
    return (
        *(number(quantile(error_m, at), 3) for at in (0.5, 0.9, 0.99, 1.0)),
        *(number(quantile(heading_deg, at), 1) for at in (0.5, 0.95)),
        share(Share(known.count(known.inside), len(known))),
        number(float(squared.mean()) if len(squared) else np.nan),
    )


def spent_figure(trials: Trials) -> Figure:
    rows: dict[str, Mapping[str, float]] = {}
    for label in trials.labels():
        some = trials.of(label=label)
        sums = {part: float(np.nansum(some.numbers(name))) for part, (_, name) in SPENT.items()}
        total = sum(sums.values())
        if total:
            rows[label] = {part: value / total for part, value in sums.items()}
    kinds = {part: kind for part, (kind, _) in SPENT.items()}
    says = "What the robot was deciding, as shares of its ticks, by navigator"
    return Figure("decisions", bars(rows, kinds, says), "What was decided, in shares of all ticks.")


def behaviour_blocks(trials: Trials) -> tuple[Block, ...]:
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
    caption = "How they drive, over all trials: how often avoiding began, and the side changed."
    return spent_figure(trials), Table(caption, head, tuple(rows))
