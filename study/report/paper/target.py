"""One figure to reach, and how shares, means and quantiles are compared with it.

A target is met when the measured value is at least as good as the target, and missed otherwise.
Values are compared before they are rounded. Intervals do not count, unless the target is a bound.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final

from study.report.words import DASH, interval, number, percent
from study.statistics.intervals import (
    Floats,
    Interval,
    Share,
    mean,
    mean_interval,
    quantile,
    quantile_interval,
)

MET: Final = "met"
MISSED: Final = "missed"
UNMEASURED: Final = "not measured"
ELSEWHERE: Final = "see there"
"""Verdict of a figure that another tool measures."""

PER: Final = 10_000


@dataclass(frozen=True, slots=True)
class StudyTarget:
    """One target, its measured value and the verdict."""

    what: str
    noise: str
    wanted: str
    measured: str
    interval: str
    verdict: str


def unmeasured(what: str, noise: str, wanted: str) -> StudyTarget:
    """Return a target without trials to measure it."""
    return StudyTarget(what, noise, wanted, DASH, DASH, UNMEASURED)


def elsewhere(what: str, noise: str, wanted: str, page: str) -> StudyTarget:
    """Return a target that another tool measures; `page` has the figure."""
    return StudyTarget(what, noise, wanted, page, DASH, ELSEWHERE)


def verdict_of(met: bool) -> str:
    """Return the verdict of a measured target."""
    return MET if met else MISSED


def at_least(what: str, noise: str, found: Share, wanted: float) -> StudyTarget:
    """Return a target for the lower limit of a share."""
    return of_share(what, noise, least(wanted), found, found.rate >= wanted)


def least(rate: float) -> str:
    """Format the lower limit of a share."""
    return f"{'≥ ' if rate < 1.0 else ''}{100 * rate:g} %"


def of_share(what: str, noise: str, wanted: str, found: Share, met: bool) -> StudyTarget:
    """Return a target for a share with its verdict."""
    if not found.of:
        return unmeasured(what, noise, wanted)
    low, high = found.interval
    measured = f"{percent(found.rate, 2)} % ({found.count} of {found.of})"
    span = f"[{percent(low)}, {percent(high)}] %"
    return StudyTarget(what, noise, wanted, measured, span, verdict_of(met))


def rarer_than(what: str, noise: str, found: Share, most: float) -> StudyTarget:
    """Return a target for the upper limit of events per 10,000 trials."""
    wanted = f"≤ {most:g}" if most else "0"
    if not found.of:
        return unmeasured(what, noise, wanted)
    measured = f"{number(PER * found.rate, 1)} ({found.count} of {found.of})"
    low, high = found.interval
    span = interval(Interval(PER * low, PER * high), 1)
    return StudyTarget(what, noise, wanted, measured, span, verdict_of(PER * found.rate <= most))


def bounded(
    what: str, noise: str, found: Share, most: float, bound: float | None = None
) -> StudyTarget:
    """Return a target for a rate per 10,000, with its exact one-sided upper bound.

    With `bound` the upper bound has a limit, too; without it the upper bound is only shown.
    """
    wanted = f"≤ {most:g}" if bound is None else f"≤ {most:g} (bound ≤ {bound:g})"
    if not found.of:
        return unmeasured(what, noise, wanted)
    measured = f"{number(PER * found.rate, 2)} ({found.count} of {found.of})"
    met = PER * found.rate <= most and (bound is None or PER * found.most <= bound)
    return StudyTarget(
        what, noise, wanted, measured, f"≤ {number(PER * found.most, 2)}", verdict_of(met)
    )


def quantile_at_most(
    what: str, noise: str, values: Sequence[float] | Floats, at: float, most: float
) -> StudyTarget:
    """Return a target for the upper limit of a quantile."""
    value = quantile(values, at)
    if not isfinite(value):
        return unmeasured(what, noise, f"≤ {most:g}")
    span = interval(quantile_interval(values, at)) if at < 1.0 else ""
    return StudyTarget(what, noise, f"≤ {most:g}", f"{value:.4g}", span, verdict_of(value <= most))


def mean_at_least(
    what: str, noise: str, values: Sequence[float] | Floats, least: float
) -> StudyTarget:
    """Return a target for the lower limit of a mean."""
    value = mean(values)
    if not isfinite(value):
        return unmeasured(what, noise, f"≥ {least:g}")
    span = interval(mean_interval(values), 3)
    return StudyTarget(
        what, noise, f"≥ {least:g}", number(value, 3), span, verdict_of(value >= least)
    )
