"""Evidence about cells of 2 cm: how often an echo came from there, or a longer one passed.

A cone gives the distance of the nearest surface, not its bearing. So an echo is evidence for the
cells of its arc that no longer echo has passed, and the fewer these are, the stronger it is. An
arc that contains a certain cell is explained by it.
"""

from typing import Final

import numpy as np

from robot.core.perception.sonar_ring import Ring
from robot.core.values import EVERY, SONARS
from study.oracle.cones import (
    CELL_MM,
    CIRCLE,
    CONE,
    QUARTER,
    REACH_MM,
    SHARES,
    Ints,
    Shorts,
    cones_of,
)

SURE: Final = 7
"""Least score of a cell that is certainly occupied."""
MAYBE: Final = 1
MOST: Final = 12
PASSED: Final = -3
"""Largest score of a cell that is certainly free: an echo does not come from there."""
LEAST_NEAR: Final = -6
LEAST_FAR: Final = -2
"""Least scores by echoes that pass nearer than FAR_MM, and farther: a post fits between rays."""
FAR_MM: Final = 900

SLACK_MM: Final = 15
SLACK_SHARE: Final = 50
"""A longer echo proves cells nearer by this slack, and by this share of the range, to be free."""
BAND_MM: Final = 14
FEW: Final = 10
SOME: Final = 20
"""Numbers of cells of an arc: FEW are 14 cm, SOME are 29 cm."""
BY_FEW: Final = 4
BY_SOME: Final = 2
MOST_SOME: Final = 6
MOST_MANY: Final = 3
CHANGED: Final = 2
"""Additional scores of the cells of an arc; with many of them the score stays at MOST_MANY."""

FOOT_MM: Final = 100
UNDERFOOT: Final = 4
"""Where the robot's body is there is no obstacle."""


class Evidence:
    """Scores of cells in rows of `width`; the first is at `left`, `low` in cells of the world."""

    def __init__(self, left: int, low: int, width: int, height: int) -> None:
        self.left, self.low, self.width, self.height = left, low, width, height
        self.score: Shorts = np.zeros(width * height, dtype=np.int16)

    def index(self, x_mm: int, y_mm: int) -> int:
        """Return the index of the cell of a place."""
        return (y_mm // CELL_MM - self.low) * self.width + x_mm // CELL_MM - self.left


def limits_of(ring: Ring, radius_mm: int) -> tuple[Shorts, Shorts]:
    """Return for each sonar the distance of its echo from the centre, and up to where it is free.

    Without a measurement both are negative; without an echo the first is beyond REACH_MM.
    """
    echo_mm, free_mm = [-REACH_MM] * SONARS, [-REACH_MM] * SONARS
    for i in EVERY:
        range_m = ring.range_m[i]
        if range_m is None:
            continue
        if range_m > 0.001 * REACH_MM:
            echo_mm[i] = free_mm[i] = 2 * REACH_MM
        else:
            range_mm = int(1000.0 * range_m)
            echo_mm[i] = range_mm + radius_mm
            free_mm[i] = echo_mm[i] - SLACK_MM - range_mm // SLACK_SHARE
    return np.array(echo_mm, dtype=np.int16), np.array(free_mm, dtype=np.int16)


def update(
    evidence: Evidence, x_mm: int, y_mm: int, heading: int, ring: Ring, radius_mm: int
) -> tuple[Ints, Shorts]:
    """Take the echoes of a ring at a pose, heading in brads.

    Return the cells whose score may have changed much, each once, and their scores before.
    """
    part_mm = CELL_MM // SHARES
    parts = x_mm % CELL_MM // part_mm, y_mm % CELL_MM // part_mm
    cones = cones_of(*parts, evidence.width)
    right = heading % CIRCLE - QUARTER + CIRCLE
    edges = [cones.first[right + CONE * i] for i in range(SONARS + 1)]
    low, high = edges[0], edges[SONARS]
    lengths = [edges[i + 1] - edges[i] for i in EVERY]
    echo_mm, free_mm = limits_of(ring, radius_mm)
    cells = cones.offset[low:high] + evidence.index(x_mm, y_mm)
    away_mm = cones.distance_mm[low:high]
    is_free = away_mm < np.repeat(free_mm, lengths)
    on_arc = np.flatnonzero(np.abs(away_mm - np.repeat(echo_mm, lengths)) <= BAND_MM)
    arcs = cells[on_arc]
    arcs_before = evidence.score[arcs]
    free, free_before = pass_through(evidence.score, cells[is_free], away_mm[is_free])
    ends = np.searchsorted(on_arc, np.array(edges) - low).tolist()
    for i in EVERY:
        if ends[i + 1] > ends[i]:
            take(evidence.score, arcs[ends[i] : ends[i + 1]])
    return np.concatenate([free, arcs]), np.concatenate([free_before, arcs_before])


def pass_through(score: Shorts, free: Ints, away_mm: Shorts) -> tuple[Ints, Shorts]:
    """Take the evidence of longer echoes; return the cells that may have been occupied."""
    here = score[free]
    least = np.where(away_mm < FAR_MM, LEAST_NEAR, LEAST_FAR)
    less = np.where(away_mm < FOOT_MM, UNDERFOOT, 1)
    score[free] = np.maximum(here - less, np.minimum(here, least))
    occupied = here >= MAYBE
    return free[occupied], here[occupied]


def take(score: Shorts, arc: Ints) -> None:
    """Take the evidence of one echo from the cells of its arc."""
    here = score[arc]
    sure = here >= SURE
    if sure.any():
        score[arc[sure]] = np.minimum(here[sure] + 1, MOST)
        return
    possible = here > PASSED
    count = int(np.count_nonzero(possible))
    if count == 0:
        score[arc] = here + CHANGED
        return
    more, most = 1, MOST_MANY
    if count <= FEW:
        more, most = BY_FEW, MOST
    elif count <= SOME:
        more, most = BY_SOME, MOST_SOME
    here = here[possible]
    score[arc[possible]] = np.maximum(here, np.minimum(here + more, most))
