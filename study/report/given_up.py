"""Goals given up: proved unreachable, lost or stuck, in worlds with a path and without one."""

from dataclasses import dataclass
from typing import Final

from protocol.outcome import LOST
from study.report.page import PageTable
from study.report.trials import Trials
from study.report.words import DASH, count, number, percent
from study.statistics.intervals import CONFIDENT, Floats, Share, quantile

PER: Final = 10_000
ENDS: Final = (LOST, "stuck")
QUANTILES: Final = (0.5, 0.9)


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenUp:
    """The goals that one navigator gave up at one noise level.

    `wronged` and `ended` are over worlds with a path to the goal, `recognised` and the rest over
    those without. `time_s` and `laps` are median and 90th percentile over the recognised.
    """

    label: str
    noise: str
    wronged: Share
    ended: tuple[Share, Share]
    doubt_m: float
    recognised: Share
    ended_shut: tuple[Share, Share]
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
        wronged=Share(reachable.count(reachable.gave_up), len(reachable)),
        ended=_ended(reachable),
        doubt_m=quantile(trials.of(outcome=LOST).numbers("doubt_m"), 0.5),
        recognised=Share(len(recognised), len(shut)),
        ended_shut=_ended(shut),
        time_s=_both(recognised.numbers("time_s")),
        laps=_both(recognised.laps),
    )


def _ended(trials: Trials) -> tuple[Share, Share]:
    lost, stuck = (Share(trials.count(trials.has(outcome=end)), len(trials)) for end in ENDS)
    return lost, stuck


def _both(values: Floats) -> tuple[float, float]:
    median, late = (quantile(values, at) for at in QUANTILES)
    return median, late


def given_up_table(trials: Trials) -> PageTable:
    """Return the table of the goals given up."""
    head = (
        *("navigator", "noise", "reachable", "called unreachable", f"at most, per {PER:,}"),
        *("lost", "stuck", "doubt when lost m", "without a path", "recognised %", "lost", "stuck"),
        *("s, median / 90th", "laps, median / 90th"),
    )
    rows = tuple(_cells(one) for one in given_up(trials))
    caption = (
        "Goals given up. `unreachable` claims a proof, `lost` is neither a way nor a proof, "
        "`stuck` cannot move or comes no closer. Called unreachable: in worlds with a path, with "
        f"the exact one-sided bound of {CONFIDENT} (Clopper and Pearson). Doubt: the longer half "
        "axis of the robot's own ellipse when it was lost, median. Seconds, and laps: over the "
        "recognised; one lap is the boundary that shuts the goal off, driven round once at top "
        "speed. The way to that boundary is not in it."
    )
    return PageTable(caption, head, rows, names=2)


def _cells(one: GivenUp) -> tuple[str, ...]:
    reachable, shut = one.wronged, one.recognised
    with_path = (
        (count(reachable.count), number(PER * reachable.most, 2), *_counts(one.ended))
        if reachable.of
        else (DASH,) * 4
    )
    without = (
        (percent(shut.rate), *_counts(one.ended_shut)) if shut.of else (DASH,) * (1 + len(ENDS))
    )
    return (
        *(one.label, one.noise, count(reachable.of), *with_path, number(one.doubt_m)),
        *(count(shut.of), *without),
        f"{number(one.time_s[0], 0)} / {number(one.time_s[1], 0)}",
        f"{number(one.laps[0])} / {number(one.laps[1])}",
    )


def _counts(ended: tuple[Share, Share]) -> tuple[str, ...]:
    return tuple(count(share.count) for share in ended)
