"""The project's own targets, compared with the trials of its own navigator.

A target is met when the measured value is at least as good as the target, and missed otherwise.
Values are compared before they are rounded. Intervals do not count, unless the target is a bound.
Worlds apart from the corpus have targets of their own: grid maps, thin walls, crowds, adversarial
worlds. Where other tools measure a figure, a row without it names their page.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import Final

import numpy as np

from runtime.units import MM_PER_M, NS_PER_S, PERIOD_NS
from study.intervals import (
    CONFIDENT,
    Floats,
    Interval,
    Proportion,
    by_world,
    mean,
    mean_interval,
    quantile,
    quantile_interval,
    ratio_interval,
)
from study.report.evidence import CYLINDERS, GRID_MAPS, BoardCost, CrowdResult, MeasuredEvidence
from study.report.page import DASH, PageCell, PageTable, interval, number, percent
from study.report.trials import (
    ADVERSARIAL,
    CORPUS,
    CROWDS,
    GRIDS,
    NOISES,
    PLANNER,
    THIN,
    Trials,
    in_group,
)

__all__ = ["MET", "MISSED", "OWN", "UNMEASURED", "StudyTarget", "target_table", "targets"]

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


def at_least(what: str, noise: str, found: Proportion, wanted: float) -> StudyTarget:
    """Return a target for the lower limit of a share."""
    return of_share(what, noise, least(wanted), found, found.rate >= wanted)


def least(rate: float) -> str:
    """Format the lower limit of a share."""
    return f"{'≥ ' if rate < 1.0 else ''}{100 * rate:g} %"


def of_share(what: str, noise: str, wanted: str, found: Proportion, met: bool) -> StudyTarget:
    """Return a target for a share with its verdict."""
    if not found.of:
        return unmeasured(what, noise, wanted)
    low, high = found.interval
    measured = f"{percent(found.rate, 2)} % ({found.count} of {found.of})"
    span = f"[{percent(low)}, {percent(high)}] %"
    return StudyTarget(what, noise, wanted, measured, span, verdict_of(met))


def rarer_than(what: str, noise: str, found: Proportion, most: float) -> StudyTarget:
    """Return a target for the upper limit of events per 10,000 trials."""
    wanted = f"≤ {most:g}" if most else "0"
    if not found.of:
        return unmeasured(what, noise, wanted)
    measured = f"{number(PER * found.rate, 1)} ({found.count} of {found.of})"
    low, high = found.interval
    span = interval(Interval(PER * low, PER * high), 1)
    return StudyTarget(what, noise, wanted, measured, span, verdict_of(PER * found.rate <= most))


def bounded(
    what: str, noise: str, found: Proportion, most: float, bound: float | None = None
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
    what: str, noise: str, trials: Trials, values: Floats, at: float, most: float
) -> StudyTarget:
    """Return a target for the upper limit of a quantile of the values of trials."""
    value = quantile(values, at)
    if not isfinite(value):
        return unmeasured(what, noise, f"≤ {most:g}")
    worlds = trials.texts("world_digest")
    span = interval(quantile_interval(values, at, worlds)) if at < 1.0 else ""
    return StudyTarget(what, noise, f"≤ {most:g}", f"{value:.4g}", span, verdict_of(value <= most))


def mean_at_least(what: str, noise: str, trials: Trials, column: str, least: float) -> StudyTarget:
    """Return a target for the lower limit of the mean over worlds of a column."""
    values = by_world(trials.numbers(column), trials.texts("world_digest"))
    value = mean(values)
    if not isfinite(value):
        return unmeasured(what, noise, f"≥ {least:g}")
    span = interval(mean_interval(values), 3)
    return StudyTarget(
        what, noise, f"≥ {least:g}", number(value, 3), span, verdict_of(value >= least)
    )


CROWD_PAGE: Final = "docs/evidence/people.md"
BOARD_PAGE: Final = "docs/evidence/microcontroller.md"
MAPS_PAGE: Final = "docs/evidence/published-maps.md"

MAP_RATES: Final = {"none": 1.0, "default": 0.99}
"""Arrivals wanted on grid maps, published and generated."""

WRONGED_PER: Final = 0.1
"""Goals wrongly called unreachable per 10,000 reachable trials."""

SCORE: Final = 0.48
CROWD: Final = "crowd"
"""The family of people up to 0.2 m/s; faster ones have no target."""

OF_STANDING: Final = 0.5
STEP_SHARE: Final = 0.5
STATE_BYTES: Final = 4096
"""Ceiling of the state that a navigator keeps from tick to tick."""
PERIOD_MS: Final = 1e3 * PERIOD_NS / NS_PER_S


def grid_map_targets(found: MeasuredEvidence) -> Iterator[StudyTarget]:
    """Yield the arrivals and the wrong claims on published grid maps."""
    results = {one.noise: one for one in found.of_maps(GRID_MAPS)}
    what = "arrives on published grid maps"
    for noise, rate in MAP_RATES.items():
        if noise in results:
            yield at_least(what, noise, results[noise].arrivals, rate)
        else:
            yield elsewhere(what, noise, least(rate), MAPS_PAGE)
    claims = "reachable goals called unreachable, published grid maps, per 10,000"
    for noise, one in results.items():
        yield bounded(claims, noise, one.wronged, WRONGED_PER)
    if not results:
        yield elsewhere(claims, "all", f"≤ {WRONGED_PER:g}", MAPS_PAGE)


def cylinder_targets(found: MeasuredEvidence) -> Iterator[StudyTarget]:
    """Yield the published score on maps of cylinders, at each scale and noise level."""
    results, wanted = found.of_maps(CYLINDERS), f"≥ {SCORE:g}"
    what = f"published score (at most 0.5), {CYLINDERS}"
    for one in results:
        span = interval(one.score_interval, 3)
        measured = f"{number(one.score, 3)} ({one.trials} maps)"
        verdict = verdict_of(one.score >= SCORE)
        words = f"{what} x {one.scale:g}, mean"
        yield StudyTarget(words, one.noise, wanted, measured, span, verdict)
    if not results:
        yield elsewhere(f"{what}, mean", "all", wanted, MAPS_PAGE)


def standing_targets(found: MeasuredEvidence, navigator: str) -> Iterator[StudyTarget]:
    """Yield the contacts among people, over those of a robot that stands in the same trials."""
    wanted = "≤ half of the standing robot's"
    rows = [one for one in found.crowds if (one.family, one.navigator) == (CROWD, navigator)]
    for one in rows:
        yield _standing(one, wanted)
    if not rows:
        yield elsewhere("crowds: trials with any contact", "all", wanted, CROWD_PAGE)


def _standing(one: CrowdResult, wanted: str) -> StudyTarget:
    what = "crowds: trials with any contact, over those of the standing robot"
    if not one.trials or not one.standing_touched:
        return unmeasured(what, one.noise, wanted)
    counts = f"{one.touched} against {one.standing_touched} of {one.trials}"
    measured = f"{number(one.touched / one.standing_touched)} x ({counts})"
    span = interval(ratio_interval(one.touched, one.trials, one.standing_touched, one.trials))
    met = one.touched <= OF_STANDING * one.standing_touched
    return StudyTarget(what, one.noise, wanted, measured, span, verdict_of(met))


def board_targets(board: BoardCost, navigator: str) -> Iterator[StudyTarget]:
    """Yield the largest modelled step and the largest state of a navigator."""
    what, wanted = "modelled worst step, of the period", f"≤ {percent(STEP_SHARE, 0)} %"
    worst_ms = board.worst_ms(navigator)
    if worst_ms:
        share = max(worst_ms) / PERIOD_MS
        measured = f"{percent(share)} % ({number(max(worst_ms), 1)} of {PERIOD_MS:g} ms)"
        drives = f"worst of {len(worst_ms)} drives"
        yield StudyTarget(what, "all", wanted, measured, drives, verdict_of(share <= STEP_SHARE))
    else:
        yield elsewhere(what, "all", wanted, BOARD_PAGE)
    what, wanted = "memory of the navigator", f"≤ {STATE_BYTES} bytes"
    size = board.state_bytes.get(navigator)
    if size is None:
        yield elsewhere(what, "all", wanted, BOARD_PAGE)
    else:
        measured = f"{size} bytes"
        yield StudyTarget(
            what, "all", wanted, measured, "largest found", verdict_of(size <= STATE_BYTES)
        )


WRONGED_BOUND_PER: Final = 1.0
"""Bound of the goals wrongly called unreachable, per 10,000 reachable trials."""

ADVERSARIAL_WRONGED_PER: Final = 10.0
THIN_RATE: Final = 0.98
CROWD_OWN: Final = 0.005
FORESTS: Final = "forest"


def apart_targets(own: Trials, navigator: str, found: MeasuredEvidence) -> Iterator[StudyTarget]:
    """Yield the targets that are not of the corpus alone.

    `own` are trials of the own `navigator`, `found` the figures of other tools.
    """
    yield from grid_targets(in_group(own, GRIDS))
    yield from grid_map_targets(found)
    yield from wronged_targets(in_group(own, CORPUS, GRIDS))
    yield adversarial_target(in_group(own, ADVERSARIAL))
    yield from thin_targets(in_group(own, THIN))
    yield from crowd_targets(in_group(own, CROWDS))
    yield from standing_targets(found, navigator)
    yield from cylinder_targets(found)
    yield from forest_targets(own)
    yield from board_targets(found.board, navigator)


def arrivals(trials: Trials) -> Proportion:
    """Return the share that arrived without a contact, of those with a path to the goal."""
    reachable = trials.where(trials.possible)
    return reachable.share(reachable.arrived)


def wronged(trials: Trials) -> Proportion:
    """Return the share called unreachable, of those with a path to the goal."""
    reachable = trials.where(trials.possible)
    return reachable.share(reachable.gave_up)


def grid_targets(grids: Trials) -> Iterator[StudyTarget]:
    """Yield the arrivals on generated grid maps."""
    for noise, rate in MAP_RATES.items():
        what = "arrives on generated grid maps (mazes, rooms, random)"
        yield at_least(what, noise, arrivals(grids.of(noise=noise)), rate)


def wronged_targets(trials: Trials) -> Iterator[StudyTarget]:
    """Yield the targets for wrong claims: at all noise levels together, and at each."""
    what = "reachable goals called unreachable, corpus and grid maps, per 10,000"
    yield bounded(what, "all", wronged(trials), WRONGED_PER, WRONGED_BOUND_PER)
    for noise in NOISES:
        yield bounded(what, noise, wronged(trials.of(noise=noise)), WRONGED_PER)


def adversarial_target(trials: Trials) -> StudyTarget:
    """Return the target for wrong claims in worlds made to fool the navigator."""
    what = "reachable goals called unreachable, adversarial worlds, per 10,000"
    return bounded(what, "none", wronged(trials.of(noise="none")), ADVERSARIAL_WRONGED_PER)


def thin_targets(thin: Trials) -> Iterator[StudyTarget]:
    """Yield the arrivals among thin walls, over all and for each thickness."""
    trials, what = thin.of(noise="lossy"), "arrives among thin walls, touches nothing"
    yield at_least(what, "lossy", arrivals(trials), THIN_RATE)
    walls_m = trials.numbers("thinnest_wall_m")
    for wall_m in sorted({value for value in walls_m.tolist() if isfinite(value)}):
        some = trials.where(walls_m == wall_m)
        words = f"arrives among walls of {MM_PER_M * wall_m:g} mm, touches nothing"
        yield at_least(words, "lossy", arrivals(some), THIN_RATE)


def crowd_targets(crowds: Trials) -> Iterator[StudyTarget]:
    """Yield the contacts among people who are not faster than 0.2 m/s."""
    slow, what = crowds.of(family=CROWD), "crowds: trials with a contact by its own motion"
    wanted = f"≤ {100 * CROWD_OWN:g} %"
    for noise in slow.values("noise"):
        some = slow.of(noise=noise)
        found = some.share(some.numbers("own_contacts") > 0.0)
        yield of_share(what, noise, wanted, found, found.rate <= CROWD_OWN)
    if not len(slow):
        yield unmeasured(what, "all", wanted)


def forest_targets(own: Trials) -> Iterator[StudyTarget]:
    """Yield the published score in the forests of the corpus, at each noise level."""
    what = "published score (at most 0.5), forests, mean"
    some = own.where(np.char.startswith(own.texts("family"), FORESTS))
    for noise in some.values("noise"):
        yield mean_at_least(what, noise, some.of(noise=noise), "published_score", SCORE)
    if not len(some):
        yield unmeasured(what, "all", f"≥ {SCORE:g}")


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
NOTHING: Final = MeasuredEvidence()
CORES: Final = 2


def targets(trials: Trials, found: MeasuredEvidence = NOTHING) -> list[StudyTarget]:
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
            yield _contacts(noises[noise], column, noise, per, what)
    for noise, trials in noises.items():
        yield from _ratio(trials, planner.of(noise=noise), noise)
    for noise, least in RECOGNISED.items():
        yield from _recognised(noises[noise], noise, least)
    for noise, trials in noises.items():
        values = trials.numbers("side_changes")
        for at, name, most in CHANGES:
            what = f"changes of side per trial, {name}"
            yield quantile_at_most(what, noise, trials, values, at, most)


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
    found = arrived.share(arrived.numbers("position_error_m") <= most_m)
    return at_least(f"of these, true position error ≤ {most_m:.2f} m", noise, found, rate)


def _ellipse(trials: Trials, noise: str) -> StudyTarget:
    arrived = trials.where(trials.arrived & trials.possible)
    found = arrived.share(arrived.inside)
    low, high = ELLIPSE
    wanted = f"{percent(low, 0)} to {percent(high, 0)} %"
    what = f"of these, true position inside its own {CONFIDENT} ellipse"
    return of_share(what, noise, wanted, found, low <= found.rate <= high)


def _contacts(trials: Trials, column: str, noise: str, most: float, what: str) -> StudyTarget:
    found = trials.share(trials.numbers(column) > 0.0)
    return rarer_than(f"trials with a contact{what}, per 10,000", noise, found, most)


def _ratio(trials: Trials, planner: Trials, noise: str) -> Iterator[StudyTarget]:
    """Yield the quantiles of the path, also over those of the planner in the same trials."""
    reachable = trials.where(trials.possible)
    common = trials.paired_with(planner).ratio
    best = planner.paired_with(trials).ratio
    for at, name, most in RATIO:
        what = f"path over shortest path, {name} of arrivals"
        found = quantile_at_most(what, noise, reachable, reachable.ratio, at, most)
        times = quantile(common, at) / quantile(best, at)
        if isfinite(times):
            measured = f"{found.measured}, {number(times, 3)} x that of `{PLANNER}`"
            verdict = MET if times <= NEAR else found.verdict
            found = replace(found, measured=measured, verdict=verdict)
        yield found


def _recognised(trials: Trials, noise: str, rate: float) -> Iterator[StudyTarget]:
    shut = trials.where(~trials.possible)
    recognised = shut.where(shut.recognised)
    found = shut.share(shut.recognised)
    yield at_least("unreachable goals recognised", noise, found, rate)
    for at, name, most in LAPS:
        what = f"time to recognise it over that of one lap, {name}"
        yield quantile_at_most(what, noise, recognised, recognised.laps, at, most)


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
