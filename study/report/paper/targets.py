"""The project's own targets, compared with the trials of its own navigator."""

from collections.abc import Iterator
from dataclasses import replace
from math import isfinite, nan
from typing import Final

import numpy as np

from study.report.groups import CORPUS, PLANNER, in_group
from study.report.page import PageCell, PageTable
from study.report.paper.apart_targets import apart_targets, arrivals
from study.report.paper.evidence import Evidence
from study.report.paper.target import (
    ELSEWHERE,
    MET,
    MISSED,
    UNMEASURED,
    StudyTarget,
    at_least,
    of_share,
    quantile_at_most,
    rarer_than,
    verdict_of,
)
from study.report.trials import NOISES, Flags, Trials
from study.report.words import number, percent
from study.statistics.intervals import CONFIDENT, Share, quantile

__all__ = ["MET", "MISSED", "OWN", "UNMEASURED", "StudyTarget", "target_table", "targets"]

OWN: Final = "vgm_memory"
ARRIVALS: Final = {"none": 0.999, "default": 0.997, "lossy": 0.993, "harsh": 0.97}
ERRORS: Final = (("none", 0.06, 1.0), ("default", 0.30, 0.98))
ELLIPSE: Final = (0.93, 0.97)
CONTACTS: Final = {"default": 0.0, "lossy": 10.0}
OWN_CONTACTS: Final = {"default": 1.0, "lossy": 5.0}
RATIO: Final = ((0.5, "median", 1.10), (0.9, "90th percentile", 2.0))
"""Quantiles of the path over the shortest one, and the largest value wanted of each."""
NEAR: Final = 1.15
"""A path that is at most so many times that of the planner is short enough, too."""

RECOGNISED: Final = {"none": 1.0, "default": 0.995}
LAPS: Final = ((0.5, "median", 1.5), (0.9, "90th percentile", 1.5))
CHANGES: Final = ((0.5, "median", 1.0), (1.0, "worst", 6.0))
WORLDS, FAMILIES = 400, 12
HOURS_PER_MINUTE: Final = 15.0
NOTHING: Final = Evidence()
CORES: Final = 2


def targets(trials: Trials, found: Evidence = NOTHING) -> list[StudyTarget]:
    """Return all targets; `trials` may be of any navigators, `found` is of other tools."""
    own = trials.of(navigator=OWN)
    return [
        *_by_noise(in_group(own, CORPUS), in_group(trials.of(navigator=PLANNER), CORPUS)),
        *apart_targets(own, OWN, found),
        *_size(in_group(own, CORPUS)),
        _speed(trials),
    ]


def _by_noise(corpus: Trials, planner: Trials) -> Iterator[StudyTarget]:
    noises = {noise: corpus.of(noise=noise) for noise in NOISES}
    for noise, trials in noises.items():
        what = "arrives by its own estimate, touches nothing"
        yield at_least(what, noise, arrivals(trials), ARRIVALS[noise])
    for noise, most_m, rate in ERRORS:
        yield _error(noises[noise], noise, most_m, rate)
    for noise, trials in noises.items():
        yield _ellipse(trials, noise)
    for what, column, limits in (
        ("", "contacts", CONTACTS),
        (", by its own motion", "own_contacts", OWN_CONTACTS),
    ):
        for noise, per in limits.items():
            yield _contacts(noises[noise].numbers(column) > 0.0, noise, per, what)
    for noise, trials in noises.items():
        yield from _ratio(trials, planner.of(noise=noise), noise)
    for noise, least in RECOGNISED.items():
        yield from _recognised(noises[noise], noise, least)
    for noise, trials in noises.items():
        values = trials.numbers("side_changes")
        for at, name, most in CHANGES:
            yield quantile_at_most(f"changes of side per trial, {name}", noise, values, at, most)


def _size(own: Trials) -> Iterator[StudyTarget]:
    worlds = len(set(own.texts("world_digest").tolist()))
    families = len(own.values("family"))
    for what, have, wanted in (("worlds", worlds, WORLDS), ("families", families, FAMILIES)):
        verdict = verdict_of(have >= wanted) if len(own) else UNMEASURED
        yield StudyTarget(
            f"{what} of the corpus", "all", f"at least {wanted}", str(have), "", verdict
        )


def _error(trials: Trials, noise: str, most_m: float, rate: float) -> StudyTarget:
    arrived = trials.where(trials.arrived & trials.possible)
    found = Share(arrived.count(arrived.numbers("position_error_m") <= most_m), len(arrived))
    return at_least(f"of these, true position error ≤ {most_m:.2f} m", noise, found, rate)


def _ellipse(trials: Trials, noise: str) -> StudyTarget:
    arrived = trials.where(trials.arrived & trials.possible)
    found = Share(arrived.count(arrived.inside), len(arrived))
    low, high = ELLIPSE
    wanted = f"{percent(low, 0)} to {percent(high, 0)} %"
    what = f"of these, true position inside its own {CONFIDENT} ellipse"
    return of_share(what, noise, wanted, found, low <= found.rate <= high)


def _contacts(touched: Flags, noise: str, most: float, what: str) -> StudyTarget:
    found = Share(int(np.count_nonzero(touched)), len(touched))
    return rarer_than(f"trials with a contact{what}, per 10,000", noise, found, most)


def _ratio(trials: Trials, planner: Trials, noise: str) -> Iterator[StudyTarget]:
    """Yield the quantiles of the path, also over those of the planner in the same trials."""
    values = trials.where(trials.possible).ratio
    common = trials.paired_with(planner).ratio
    best = planner.paired_with(trials).ratio
    for at, name, most in RATIO:
        what = f"path over shortest path, {name} of arrivals"
        found = quantile_at_most(what, noise, values, at, most)
        times = quantile(common, at) / quantile(best, at)
        if isfinite(times):
            measured = f"{found.measured}, {number(times, 3)} x that of `{PLANNER}`"
            verdict = MET if times <= NEAR else found.verdict
            found = replace(found, measured=measured, verdict=verdict)
        yield found


def _recognised(trials: Trials, noise: str, rate: float) -> Iterator[StudyTarget]:
    shut = trials.where(~trials.possible)
    recognised = shut.where(shut.recognised)
    found = Share(len(recognised), len(shut))
    yield at_least("unreachable goals recognised", noise, found, rate)
    for at, name, most in LAPS:
        what = f"time to recognise it over that of one lap, {name}"
        yield quantile_at_most(what, noise, recognised.laps, at, most)


def _speed(trials: Trials) -> StudyTarget:
    forest = np.char.startswith(trials.texts("family"), "forest")
    own = ~trials.has(navigator=PLANNER)
    chosen = trials.where(forest & own & np.isfinite(trials.numbers("wall_s")))
    wall_s = float(chosen.numbers("wall_s").sum())
    hours = float(chosen.numbers("time_s").sum()) / 3600.0
    pace = CORES * hours / (wall_s / 60.0) if wall_s > 0.0 else nan
    what = f"simulated hours per minute in forests with {CORES} workers"
    verdict = verdict_of(pace >= HOURS_PER_MINUTE) if isfinite(pace) else UNMEASURED
    return StudyTarget(what, "all", f"≥ {HOURS_PER_MINUTE:g}", number(pace, 1), "", verdict)


def target_table(found: list[StudyTarget]) -> PageTable:
    """Return the table of the targets."""
    tones = {MET: "good", MISSED: "bad", UNMEASURED: "none", ELSEWHERE: "none"}
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
        f"{CONFIDENT}: Wilson's for shares, order statistics for quantiles, the normal "
        "approximation for means, Katz's for the ratio to the standing robot. A single limit `≤` "
        "is Clopper and Pearson's one-sided bound. Met: the measured figure is at least as good as "
        "the wanted one, and so is the bound where one is wanted. The bound of wrong claims is "
        "wanted of all noise levels together; one level has fewer trials, so its own bound is "
        "higher. A path is short enough, too, when its quantile is at most "
        f"{NEAR:g} times that of `{PLANNER}`, a planner with unlimited memory and the same senses, "
        "over the trials in which both arrived. Published maps, the standing robot, the worst step "
        "and the memory are figures of other tools; where they were not read, the row names their "
        "page."
    )
    return PageTable(
        caption, ("what", "noise", "wanted", "measured", "interval", ""), rows, names=2
    )
