"""Targets whose figures other tools measured; without these figures a row names their page."""

from collections.abc import Iterator
from typing import Final

from runtime.timing import PERIOD_NS
from runtime.units import NS_PER_S
from study.report.paper.evidence import CYLINDERS, GRID_MAPS, BoardCost, CrowdResult, Evidence
from study.report.paper.target import (
    StudyTarget,
    at_least,
    bounded,
    elsewhere,
    least,
    unmeasured,
    verdict_of,
)
from study.report.words import interval, number, percent
from study.statistics.intervals import ratio_interval

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
PERIOD_MS: Final = 1e3 * PERIOD_NS / NS_PER_S


def grid_map_targets(found: Evidence) -> Iterator[StudyTarget]:
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


def cylinder_targets(found: Evidence) -> Iterator[StudyTarget]:
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


def standing_targets(found: Evidence, navigator: str) -> Iterator[StudyTarget]:
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
