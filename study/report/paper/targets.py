"""The project's own targets, compared with the trials of its own navigator.

A target is met when the measured value is at least as good as the target, and missed otherwise;
intervals do not count. Values are compared before they are rounded.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite, nan
from typing import Final

import numpy as np

from study.report.page import PageCell, PageTable
from study.report.trials import NOISES, Flags, Trials
from study.report.words import DASH, interval, number, percent
from study.statistics.intervals import (
    CONFIDENT,
    Floats,
    Interval,
    Share,
    quantile,
    quantile_interval,
)

OWN: Final = "vgm_memory"
GRIDS: Final = ("moving_ai", "movingai", "grid")
"""Prefixes of the families in Moving AI's format, which have a target of their own."""

MET: Final = "met"
MISSED: Final = "missed"
UNMEASURED: Final = "not measured"

ARRIVALS: Final = {"none": 0.995, "default": 0.99, "lossy": 0.98, "harsh": 0.95}
ERRORS: Final = (("none", 0.06, 1.0), ("default", 0.30, 0.98))
ELLIPSE: Final = (0.93, 0.97)
CONTACTS: Final = {"default": 0.0, "lossy": 10.0}
RATIO: Final = ((0.5, "median", 1.15), (0.9, "90th percentile", 2.5))
UNREACHABLE_S: Final = 60.0
CHANGES: Final = ((0.5, "median", 1.0), (1.0, "worst", 4.0))
GRID_RATE: Final = 0.97
WORLDS, FAMILIES = 400, 12
HOURS_PER_MINUTE: Final = 15.0
CORES: Final = 2


@dataclass(frozen=True, slots=True)
class StudyTarget:
    """One target, its measured value and the verdict."""

    what: str
    noise: str
    wanted: str
    measured: str
    interval: str
    verdict: str


def targets(trials: Trials) -> list[StudyTarget]:
    """Return all targets; `trials` may be of any navigators."""
    own = trials.of(navigator=OWN)
    grid = np.array([f.startswith(GRIDS) for f in own.texts("family").tolist()], dtype=np.bool_)
    corpus, grids = own.where(~grid), own.where(grid)
    return [
        *_corpus(corpus),
        *_by_noise(corpus),
        *_grids(grids),
        _speed(trials),
    ]


def _by_noise(corpus: Trials) -> Iterator[StudyTarget]:
    noises = {noise: corpus.of(noise=noise) for noise in NOISES}
    for noise, trials in noises.items():
        yield _arrivals(trials, noise)
    for noise, most_m, rate in ERRORS:
        yield _error(noises[noise], noise, most_m, rate)
    for noise, trials in noises.items():
        yield _ellipse(trials, noise)
    for noise, most in CONTACTS.items():
        trials = noises[noise]
        for what, column in (("", "contacts"), (", by its own motion", "own_contacts")):
            yield _contacts(trials.numbers(column) > 0.0, noise, most, what)
    for noise, trials in noises.items():
        yield from _ratio(trials, noise)
    for noise, trials in noises.items():
        yield from _unreachable(trials, noise)
    for noise, trials in noises.items():
        yield from _changes(trials, noise)


def _corpus(own: Trials) -> Iterator[StudyTarget]:
    worlds = len(set(own.texts("world_digest").tolist()))
    families = len(own.values("family"))
    for what, have, wanted in (("worlds", worlds, WORLDS), ("families", families, FAMILIES)):
        verdict = UNMEASURED if not len(own) else MET if have >= wanted else MISSED
        yield StudyTarget(
            f"{what} of the corpus", "all", f"at least {wanted}", str(have), "", verdict
        )


def _arrivals(trials: Trials, noise: str) -> StudyTarget:
    reachable = trials.where(trials.possible)
    found = Share(reachable.count(reachable.arrived), len(reachable))
    return at_least("arrives by its own estimate, touches nothing", noise, found, ARRIVALS[noise])


def _error(trials: Trials, noise: str, most_m: float, rate: float) -> StudyTarget:
    arrivals = trials.where(trials.arrived & trials.possible)
    found = Share(arrivals.count(arrivals.numbers("position_error_m") <= most_m), len(arrivals))
    return at_least(f"of these, true position error ≤ {most_m:.2f} m", noise, found, rate)


def _ellipse(trials: Trials, noise: str) -> StudyTarget:
    arrivals = trials.where(trials.arrived & trials.possible)
    found = Share(arrivals.count(arrivals.inside), len(arrivals))
    low, high = ELLIPSE
    wanted = f"{percent(low, 0)} to {percent(high, 0)} %"
    what = f"of these, true position inside its own {CONFIDENT} ellipse"
    return _of_share(what, noise, wanted, found, low <= found.rate <= high)


def at_least(what: str, noise: str, found: Share, wanted: float) -> StudyTarget:
    """Return a target for the lower limit of a share."""
    return _of_share(
        what,
        noise,
        f"{'≥ ' if wanted < 1.0 else ''}{100 * wanted:g} %",
        found,
        found.rate >= wanted,
    )


def _of_share(what: str, noise: str, wanted: str, found: Share, met: bool) -> StudyTarget:
    if not found.of:
        return StudyTarget(what, noise, wanted, DASH, DASH, UNMEASURED)
    low, high = found.interval
    measured = f"{percent(found.rate, 2)} % ({found.count} of {found.of})"
    span = f"[{percent(low)}, {percent(high)}] %"
    return StudyTarget(what, noise, wanted, measured, span, MET if met else MISSED)


def _contacts(touched: Flags, noise: str, most: float, what: str) -> StudyTarget:
    found = Share(int(np.count_nonzero(touched)), len(touched))
    text = f"trials with a contact{what}, per 10,000"
    wanted = f"≤ {most:g}" if most else "0"
    if not found.of:
        return StudyTarget(text, noise, wanted, DASH, DASH, UNMEASURED)
    per = 10_000.0
    measured = f"{number(per * found.rate, 1)} ({found.count} of {found.of})"
    low, high = found.interval
    span = interval(Interval(per * low, per * high), 1)
    return StudyTarget(
        text, noise, wanted, measured, span, MET if per * found.rate <= most else MISSED
    )


def _ratio(trials: Trials, noise: str) -> Iterator[StudyTarget]:
    values = trials.where(trials.possible).ratio
    for at, name, most in RATIO:
        yield _at_most(f"path over shortest path, {name} of arrivals", noise, values, at, most)


def _at_most(what: str, noise: str, values: Floats, at: float, most: float) -> StudyTarget:
    value = quantile(values, at)
    if not isfinite(value):
        return StudyTarget(what, noise, f"≤ {most:g}", DASH, DASH, UNMEASURED)
    span = interval(quantile_interval(values, at)) if at < 1.0 else ""
    verdict = MET if value <= most else MISSED
    return StudyTarget(what, noise, f"≤ {most:g}", f"{value:.4g}", span, verdict)


def _unreachable(trials: Trials, noise: str) -> Iterator[StudyTarget]:
    reachable, unreachable = trials.where(trials.possible), trials.where(~trials.possible)
    recognised = unreachable.where(unreachable.recognised)
    yield at_least(
        "unreachable goals recognised", noise, Share(len(recognised), len(unreachable)), 1.0
    )
    time_s = recognised.numbers("time_s")
    yield _at_most("time to recognise it, median, s", noise, time_s, 0.5, UNREACHABLE_S)
    wronged = Share(reachable.count(reachable.gave_up), len(reachable))
    what = "reachable goals called unreachable"
    yield _of_share(what, noise, "0", wronged, wronged.count == 0)


def _changes(trials: Trials, noise: str) -> Iterator[StudyTarget]:
    values = trials.numbers("side_changes")
    for at, name, most in CHANGES:
        yield _at_most(f"changes of side per trial, {name}", noise, values, at, most)


def _grids(grids: Trials) -> Iterator[StudyTarget]:
    trials = grids.of(noise="none")
    reachable = trials.where(trials.possible)
    found = Share(reachable.count(reachable.arrived), len(reachable))
    yield at_least("arrives in grid mazes, rooms and random maps", "none", found, GRID_RATE)


def _speed(trials: Trials) -> StudyTarget:
    forest = np.char.startswith(trials.texts("family"), "forest")
    chosen = trials.where(forest & np.isfinite(trials.numbers("wall_s")))
    wall_s = float(chosen.numbers("wall_s").sum())
    hours = float(chosen.numbers("time_s").sum()) / 3600.0
    pace = CORES * hours / (wall_s / 60.0) if wall_s > 0.0 else nan
    what = f"simulated hours per minute in forests with {CORES} workers"
    verdict = UNMEASURED if not isfinite(pace) else MET if pace >= HOURS_PER_MINUTE else MISSED
    return StudyTarget(what, "all", f"≥ {HOURS_PER_MINUTE:g}", number(pace, 1), "", verdict)


def target_table(found: list[StudyTarget]) -> PageTable:
    """Return the table of the targets."""
    tones = {MET: "good", MISSED: "bad", UNMEASURED: "none"}
    rows = tuple(
        (
            *(one.what, one.noise, one.wanted, one.measured, one.interval),
            PageCell(one.verdict, tones[one.verdict]),
        )
        for one in found
    )
    counts = ", ".join(
        f"{sum(one.verdict == verdict for one in found)} {verdict}" for verdict in tones
    )
    caption = (
        f"Figures to reach, of `{OWN}` unless stated otherwise: {counts}. Intervals of "
        f"{CONFIDENT}: Wilson's for shares, order statistics for quantiles. Met: the measured "
        "figure is at least as good as the wanted one."
    )
    return PageTable(
        caption, ("what", "noise", "wanted", "measured", "interval", ""), rows, names=2
    )
