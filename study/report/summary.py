"""Navigator by noise level: tables, figures and `summary.json`, and the goals given up.

A goal is given up as proved unreachable, lost or stuck, in worlds with a path and without one.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from math import isfinite
from typing import Final

import numpy as np

from protocol.outcome import LOST
from study.intervals import CONFIDENT, Floats, Proportion, mean, quantile
from study.report.charts import bars, distribution_chart, success_chart
from study.report.page import DASH, Block, PageFigure, PageTable, count_text, number, percent, share
from study.report.targets import ERRORS, PER, RATIO
from study.report.trials import Trials
from study.runner.run_task import FULL_SCORE

HEAD: Final = (
    *("navigator", "noise", "worlds", "trials", "success %", "touched something %"),
    *("true error m, median / 95th", "in own ellipse %", "path / shortest, median (90th)"),
    *("unreachable recognised %", "reached without a way %"),
    *("wrongly called %", "lost %", "stuck %", "timeout %"),
    *("SPL", "published score"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigatorSummary:
    """One navigator at one noise level.

    `success` and the following are over worlds with a path to the goal, `recognised` and
    `false_arrivals`, which ended as reached, over those without. `wronged` counts goals wrongly
    called unreachable; `lost`, `stuck` and `timeout` goals that could be reached. `spl` and
    `score` are means over the same worlds.
    """

    label: str
    noise: str
    worlds: int
    reachable_worlds: int
    success: Proportion
    touched: Proportion
    contacts: int
    own_contacts: int
    error_m: tuple[float, float, float]
    """Median, 95th percentile and maximum of the true position error of arrivals."""
    heading_deg: tuple[float, float]
    inside: Proportion
    ratio: tuple[float, float]
    time_s: float
    clearance_m: tuple[float, float]
    side_changes: tuple[float, float]
    recognised: Proportion
    false_arrivals: Proportion
    recognised_s: float
    wronged: Proportion
    lost: Proportion
    stuck: Proportion
    timeout: Proportion
    spl: float
    score: float


def summaries(trials: Trials) -> list[NavigatorSummary]:
    """Summarise every navigator at every noise level."""
    return [
        summary(trials.of(label=label, noise=noise), label, noise)
        for label in trials.labels()
        for noise in trials.values("noise")
        if len(trials.of(label=label, noise=noise))
    ]


def summary(trials: Trials, label: str, noise: str) -> NavigatorSummary:
    """Summarise the trials of one navigator at one noise level."""
    reachable, unreachable = trials.where(trials.possible), trials.where(~trials.possible)
    arrivals = reachable.where(reachable.arrived)
    recognised = unreachable.where(unreachable.recognised)
    touched = trials.numbers("contacts") > 0.0
    known = arrivals.where(np.isfinite(arrivals.numbers("mahalanobis2")))
    error_m, turned = arrivals.numbers("position_error_m"), arrivals.numbers("heading_error_rad")
    clearance_m, changes = arrivals.numbers("min_clearance_m"), trials.numbers("side_changes")
    return NavigatorSummary(
        label=label,
        noise=noise,
        worlds=trials.worlds,
        reachable_worlds=reachable.worlds,
        success=reachable.share(reachable.arrived),
        touched=trials.share(touched),
        contacts=_total(trials.numbers("contacts")),
        own_contacts=_total(trials.numbers("own_contacts")),
        error_m=(quantile(error_m, 0.5), quantile(error_m, 0.95), quantile(error_m, 1.0)),
        heading_deg=(quantile(np.degrees(turned), 0.5), quantile(np.degrees(turned), 0.95)),
        inside=known.share(known.inside),
        ratio=(quantile(arrivals.ratio, 0.5), quantile(arrivals.ratio, 0.9)),
        time_s=quantile(arrivals.numbers("time_s"), 0.5),
        clearance_m=(quantile(clearance_m, 0.0), quantile(clearance_m, 0.5)),
        side_changes=(quantile(changes, 0.5), quantile(changes, 1.0)),
        recognised=unreachable.share(unreachable.recognised),
        false_arrivals=unreachable.share(unreachable.has(outcome="reached")),
        recognised_s=quantile(recognised.numbers("time_s"), 0.5),
        wronged=reachable.share(reachable.gave_up),
        lost=reachable.share(reachable.has(outcome=LOST)),
        stuck=reachable.share(reachable.has(outcome="stuck")),
        timeout=reachable.share(reachable.has(outcome="timeout")),
        spl=mean(reachable.numbers("spl")),
        score=mean(reachable.numbers("published_score")),
    )


def _total(values: Floats) -> int:
    return int(np.nansum(values))


def cells(found: NavigatorSummary) -> tuple[str, ...]:
    """Return the cells of a summary, in the order of HEAD."""
    unreachable = found.recognised
    return (
        *(
            found.label,
            found.noise,
            count_text(found.worlds),
            count_text(found.success.of + unreachable.of),
        ),
        *(share(found.success), percent(found.touched.rate, 2)),
        f"{number(found.error_m[0], 3)} / {number(found.error_m[1], 3)}",
        percent(found.inside.rate),
        f"{number(found.ratio[0])} ({number(found.ratio[1])})",
        f"{percent(unreachable.rate)} (of {count_text(unreachable.of)})"
        if unreachable.of
        else DASH,
        percent(found.false_arrivals.rate),
        *(percent(one.rate, 2) for one in (found.wronged, found.lost, found.stuck, found.timeout)),
        *(number(found.spl, 3), number(found.score, 3)),
    )


def as_json(found: Iterable[NavigatorSummary]) -> list[dict[str, str]]:
    """Return the cells by their heading, as committed and compared with the README."""
    return [dict(zip(HEAD, cells(one), strict=True)) for one in found]


def numbers(found: NavigatorSummary) -> dict[str, str | int | float | None]:
    """Return all values unrounded, by name; None where unknown."""
    row: dict[str, str | int | float | None] = {}
    for field in fields(found):
        value = getattr(found, field.name)
        if isinstance(value, Proportion):
            row |= {field.name: value.count, f"{field.name}_of": value.of}
            row |= {
                f"{field.name}_low": value.interval.low,
                f"{field.name}_high": value.interval.high,
            }
        elif isinstance(value, tuple):
            row |= {f"{field.name}_{place}": _known(one) for place, one in enumerate(value)}
        else:
            row[field.name] = _known(value) if isinstance(value, float) else value
    return row


def _known(value: float) -> float | None:
    return value if isfinite(value) else None


def main_table(found: Iterable[NavigatorSummary]) -> PageTable:
    """Return the main table."""
    caption = (
        "Success: reached the goal by its own estimate and touched nothing, in worlds with a path; "
        f"in brackets the Wilson interval of {CONFIDENT}, clustered by world. Error, ellipse and "
        "path ratio are over these arrivals. Recognised: reported `unreachable` where there is no "
        "path; wrongly called: where there is one. Reached without a way: reported `reached` where "
        "there is none. Lost, stuck and timeout: where there is a path. SPL: mean of success x "
        "shortest path / path. Published score: mean of success x optimal time / time, with the "
        f"time at least 2 and at most 8 times the optimal one, so at most {FULL_SCORE:g}; the "
        "optimal time is that of the shortest path at the robot's own top speed."
    )
    return PageTable(caption, HEAD, tuple(cells(one) for one in found), names=2)


def more_table(found: Iterable[NavigatorSummary]) -> PageTable:
    """Return the table of further values."""
    head = (
        *("navigator", "noise", "contacts (own)", "worst error m"),
        *(
            "heading error deg, median / 95th",
            "time s, median",
            "clearance m, least / median",
            "side changes, median / worst",
        ),
        "unreachable, s median",
    )
    rows = tuple(
        (
            *(one.label, one.noise, f"{count_text(one.contacts)} ({count_text(one.own_contacts)})"),
            number(one.error_m[2], 3),
            f"{number(one.heading_deg[0], 1)} / {number(one.heading_deg[1], 1)}",
            number(one.time_s, 1),
            f"{number(one.clearance_m[0], 3)} / {number(one.clearance_m[1], 3)}",
            f"{_whole(one.side_changes[0])} / {_whole(one.side_changes[1])}",
            number(one.recognised_s, 1),
        )
        for one in found
    )
    caption = (
        "Further values. Contacts and side changes are over all trials; in brackets contacts "
        "caused by the robot's own motion. Clearance: the smallest distance to an obstacle in an "
        "arrival, least and median over arrivals."
    )
    return PageTable(caption, head, rows, names=2)


def _whole(value: float) -> str:
    return f"{value:g}" if isfinite(value) else DASH


GIVEN_UP_ENDS: Final = (LOST, "stuck", "timeout")
QUANTILES: Final = (0.5, 0.9)


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenUp:
    """The goals that one navigator gave up at one noise level.

    `wronged` and `ended` are over worlds with a path to the goal, `recognised`, `false_arrivals`
    and the rest over those without; the `ended` ones are in the order of GIVEN_UP_ENDS. `time_s`
    and `laps` are median and 90th percentile over the recognised.
    """

    label: str
    noise: str
    wronged: Proportion
    ended: tuple[Proportion, ...]
    doubt_m: float
    recognised: Proportion
    false_arrivals: Proportion
    ended_shut: tuple[Proportion, ...]
    time_s: tuple[float, float]
    laps: tuple[float, float]


def given_up(trials: Trials) -> list[GivenUp]:
    """Return a row for each navigator at each noise level."""
    return [
        _given_up(trials.of(label=label, noise=noise), label, noise)
        for label in trials.labels()
        for noise in trials.values("noise")
        if len(trials.of(label=label, noise=noise))
    ]


def _given_up(trials: Trials, label: str, noise: str) -> GivenUp:
    reachable, shut = trials.where(trials.possible), trials.where(~trials.possible)
    recognised = shut.where(shut.recognised)
    return GivenUp(
        label=label,
        noise=noise,
        wronged=reachable.share(reachable.gave_up),
        ended=_ended(reachable),
        doubt_m=quantile(trials.of(outcome=LOST).numbers("doubt_m"), 0.5),
        recognised=shut.share(shut.recognised),
        false_arrivals=shut.share(shut.has(outcome="reached")),
        ended_shut=_ended(shut),
        time_s=_both(recognised.numbers("time_s")),
        laps=_both(recognised.laps),
    )


def _ended(trials: Trials) -> tuple[Proportion, ...]:
    return tuple(trials.share(trials.has(outcome=end)) for end in GIVEN_UP_ENDS)


def _both(values: Floats) -> tuple[float, float]:
    median, late = (quantile(values, at) for at in QUANTILES)
    return median, late


def given_up_table(trials: Trials) -> PageTable:
    """Return the table of the goals given up."""
    head = (
        *("navigator", "noise", "reachable", "called unreachable", f"at most, per {PER:,}"),
        *(*GIVEN_UP_ENDS, "doubt when lost m", "without a path", "recognised %", "reached"),
        *(*GIVEN_UP_ENDS, "s, median / 90th", "laps, median / 90th"),
    )
    rows = tuple(_cells(one) for one in given_up(trials))
    caption = (
        "Goals given up. `unreachable` claims a proof, `lost` is neither a way nor a proof, "
        "`stuck` cannot move or comes no closer, `timeout` has no end; `reached` without a path "
        "is a false arrival. Called unreachable: in worlds with a path, with "
        f"the exact one-sided bound of {CONFIDENT} (Clopper and Pearson). Doubt: the longer half "
        "axis of the robot's own ellipse when it was lost, median. Seconds, and laps: over the "
        "recognised; one lap is the boundary that shuts the goal off, driven round once at top "
        "speed. The way to that boundary is not in it."
    )
    return PageTable(caption, head, rows, names=2)


def _cells(one: GivenUp) -> tuple[str, ...]:
    reachable, shut = one.wronged, one.recognised
    with_path = (
        (count_text(reachable.count), number(PER * reachable.most, 2), *_counts(one.ended))
        if reachable.of
        else (DASH,) * (2 + len(GIVEN_UP_ENDS))
    )
    without = (
        (percent(shut.rate), *_counts((one.false_arrivals, *one.ended_shut)))
        if shut.of
        else (DASH,) * (2 + len(GIVEN_UP_ENDS))
    )
    return (
        *(one.label, one.noise, count_text(reachable.of), *with_path, number(one.doubt_m)),
        *(count_text(shut.of), *without),
        f"{number(one.time_s[0], 0)} / {number(one.time_s[1], 0)}",
        f"{number(one.laps[0])} / {number(one.laps[1])}",
    )


def _counts(ended: tuple[Proportion, ...]) -> tuple[str, ...]:
    return tuple(count_text(share.count) for share in ended)


KINDS_OF_ENDS: Final = {
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


def success_figure(found: list[NavigatorSummary]) -> PageFigure:
    """Return success by navigator and noise level."""
    panels: dict[str, dict[str, Proportion]] = {}
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
                    end: some.count(some.has(outcome=end)) / len(some) for end in KINDS_OF_ENDS
                }
    used = {
        end: kind for end, kind in KINDS_OF_ENDS.items() if any(row[end] for row in rows.values())
    }
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
        share(known.share(known.inside)),
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
