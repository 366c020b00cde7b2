"""Targets in worlds apart from the corpus: grid maps, thin walls, crowds, adversarial worlds."""

from collections.abc import Iterator
from math import isfinite
from typing import Final

import numpy as np

from study.report.groups import ADVERSARIAL, CORPUS, CROWDS, GRIDS, THIN, in_group
from study.report.paper.evidence import Evidence
from study.report.paper.evidence_targets import (
    CROWD,
    MAP_RATES,
    SCORE,
    WRONGED_PER,
    board_targets,
    cylinder_targets,
    grid_map_targets,
    standing_targets,
)
from study.report.paper.target import (
    StudyTarget,
    at_least,
    bounded,
    mean_at_least,
    of_share,
    unmeasured,
)
from study.report.trials import NOISES, Trials
from study.statistics.intervals import Share

WRONGED_BOUND_PER: Final = 1.0
"""Bound of the goals wrongly called unreachable, per 10,000 reachable trials."""

ADVERSARIAL_WRONGED_PER: Final = 10.0
THIN_RATE: Final = 0.98
MM_PER_M: Final = 1000.0
CROWD_OWN: Final = 0.005
FORESTS: Final = "forest"


def apart_targets(own: Trials, navigator: str, found: Evidence) -> Iterator[StudyTarget]:
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


def arrivals(trials: Trials) -> Share:
    """Return the share that arrived without a contact, of those with a path to the goal."""
    reachable = trials.where(trials.possible)
    return Share(reachable.count(reachable.arrived), len(reachable))


def wronged(trials: Trials) -> Share:
    """Return the share called unreachable, of those with a path to the goal."""
    reachable = trials.where(trials.possible)
    return Share(reachable.count(reachable.gave_up), len(reachable))


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
        found = Share(some.count(some.numbers("own_contacts") > 0.0), len(some))
        yield of_share(what, noise, wanted, found, found.rate <= CROWD_OWN)
    if not len(slow):
        yield unmeasured(what, "all", wanted)


def forest_targets(own: Trials) -> Iterator[StudyTarget]:
    """Yield the published score in the forests of the corpus, at each noise level."""
    what = "published score (at most 0.5), forests, mean"
    some = own.where(np.char.startswith(own.texts("family"), FORESTS))
    for noise in some.values("noise"):
        values = some.of(noise=noise).numbers("published_score")
        yield mean_at_least(what, noise, values, SCORE)
    if not len(some):
        yield unmeasured(what, "all", f"≥ {SCORE:g}")
