"""Navigator by noise level: the tables of the summary and `summary.json`."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from math import isfinite
from typing import Final

import numpy as np

from protocol.outcome import LOST
from study.report.page import PageTable
from study.report.trials import Trials
from study.report.words import DASH, count, number, percent, share
from study.runner.scores import FULL_SCORE
from study.statistics.intervals import CONFIDENT, Floats, Share, mean, quantile

HEAD: Final = (
    *("navigator", "noise", "worlds", "trials", "success %", "touched something %"),
    *("true error m, median / 95th", "in own ellipse %", "path / shortest, median (90th)"),
    *("unreachable recognised %", "wrongly called %", "lost %", "stuck %"),
    *("SPL", "published score"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """One navigator at one noise level.

    `success` and the following are over worlds with a path to the goal, `recognised` over those
    without. `wronged` counts goals wrongly called unreachable; `lost` and `stuck` goals that could
    be reached. `spl` and `score` are means over the same worlds.
    """

    label: str
    noise: str
    worlds: int
    success: Share
    touched: Share
    contacts: int
    own_contacts: int
    error_m: tuple[float, float, float]
    """Median, 95th percentile and maximum of the true position error of arrivals."""
    heading_deg: tuple[float, float]
    inside: Share
    ratio: tuple[float, float]
    time_s: float
    clearance_m: tuple[float, float]
    side_changes: tuple[float, float]
    recognised: Share
    recognised_s: float
    wronged: Share
    lost: Share
    stuck: Share
    spl: float
    score: float


def summaries(trials: Trials) -> list[Summary]:
    """Summarise every navigator at every noise level."""
    return [
        summary(trials.of(label=label, noise=noise), label, noise)
        for label in trials.labels()
        for noise in trials.values("noise")
        if len(trials.of(label=label, noise=noise))
    ]


def summary(trials: Trials, label: str, noise: str) -> Summary:
    """Summarise the trials of one navigator at one noise level."""
    reachable, unreachable = trials.where(trials.possible), trials.where(~trials.possible)
    arrivals = reachable.where(reachable.arrived)
    recognised = unreachable.where(unreachable.recognised)
    touched = trials.numbers("contacts") > 0.0
    known = arrivals.where(np.isfinite(arrivals.numbers("mahalanobis2")))
    error_m, turned = arrivals.numbers("position_error_m"), arrivals.numbers("heading_error_rad")
    clearance_m, changes = arrivals.numbers("min_clearance_m"), trials.numbers("side_changes")
    return Summary(
        label=label,
        noise=noise,
        worlds=len(set(trials.texts("world_digest").tolist())),
        success=Share(len(arrivals), len(reachable)),
        touched=Share(trials.count(touched), len(trials)),
        contacts=_total(trials.numbers("contacts")),
        own_contacts=_total(trials.numbers("own_contacts")),
        error_m=(quantile(error_m, 0.5), quantile(error_m, 0.95), quantile(error_m, 1.0)),
        heading_deg=(quantile(np.degrees(turned), 0.5), quantile(np.degrees(turned), 0.95)),
        inside=Share(known.count(known.inside), len(known)),
        ratio=(quantile(arrivals.ratio, 0.5), quantile(arrivals.ratio, 0.9)),
        time_s=quantile(arrivals.numbers("time_s"), 0.5),
        clearance_m=(quantile(clearance_m, 0.0), quantile(clearance_m, 0.5)),
        side_changes=(quantile(changes, 0.5), quantile(changes, 1.0)),
        recognised=Share(len(recognised), len(unreachable)),
        recognised_s=quantile(recognised.numbers("time_s"), 0.5),
        wronged=Share(reachable.count(reachable.gave_up), len(reachable)),
        lost=Share(reachable.count(reachable.has(outcome=LOST)), len(reachable)),
        stuck=Share(reachable.count(reachable.has(outcome="stuck")), len(reachable)),
        spl=mean(reachable.numbers("spl")),
        score=mean(reachable.numbers("published_score")),
    )


def _total(values: Floats) -> int:
    return int(np.nansum(values))


def cells(found: Summary) -> tuple[str, ...]:
    """Return the cells of a summary, in the order of HEAD."""
    unreachable, wronged = found.recognised, found.wronged
    return (
        *(found.label, found.noise, count(found.worlds), count(found.success.of + unreachable.of)),
        *(share(found.success), percent(found.touched.rate, 2)),
        f"{number(found.error_m[0], 3)} / {number(found.error_m[1], 3)}",
        percent(found.inside.rate),
        f"{number(found.ratio[0])} ({number(found.ratio[1])})",
        f"{percent(unreachable.rate)} (of {count(unreachable.of)})" if unreachable.of else DASH,
        *(percent(one.rate, 2) for one in (wronged, found.lost, found.stuck)),
        *(number(found.spl, 3), number(found.score, 3)),
    )


def as_json(found: Iterable[Summary]) -> list[dict[str, str]]:
    """Return the cells by their heading, as committed and compared with the README."""
    return [dict(zip(HEAD, cells(one), strict=True)) for one in found]


def numbers(found: Summary) -> dict[str, str | int | float | None]:
    """Return all values unrounded, by name; None where unknown."""
    row: dict[str, str | int | float | None] = {}
    for field in fields(found):
        value = getattr(found, field.name)
        if isinstance(value, Share):
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


def main_table(found: Iterable[Summary]) -> PageTable:
    """Return the main table."""
    caption = (
        "Success: reached the goal by its own estimate and touched nothing, in worlds with a path; "
        f"in brackets the Wilson interval of {CONFIDENT}. Error, ellipse and path ratio are over "
        "these arrivals. Recognised: reported `unreachable` where there is no path; wrongly "
        "called: where there is one. Lost and stuck: where there is a path. SPL: mean of success x "
        "shortest path / path. Published score: mean of success x optimal time / time, with the "
        f"time at least 2 and at most 8 times the optimal one, so at most {FULL_SCORE:g}; the "
        "optimal time is that of the shortest path at the robot's own top speed."
    )
    return PageTable(caption, HEAD, tuple(cells(one) for one in found), names=2)


def more_table(found: Iterable[Summary]) -> PageTable:
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
            *(one.label, one.noise, f"{count(one.contacts)} ({count(one.own_contacts)})"),
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
