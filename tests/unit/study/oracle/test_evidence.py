"""Evidence of echoes: arcs, cells that an echo passes, and arcs that are explained."""

from math import inf

import numpy as np

from robot.core.perception.sonar_ring import Ring
from study.oracle.grid_map import (
    LEAST_NEAR,
    MAYBE,
    MOST,
    MOST_MANY,
    PASSED,
    SURE,
    CellEvidence,
    take,
    update_evidence,
)
from tests.support.each import each

RADIUS_MM = 120
AHEAD_MM = 100 + RADIUS_MM


def grid() -> CellEvidence:
    return CellEvidence(-200, -200, 400, 400)


def ring_with(ranges: dict[int, float | None], other: float | None = None) -> Ring:
    ring = Ring()
    ring.range_m = [ranges.get(i, other) for i in range(8)]
    return ring


def at(evidence: CellEvidence, x_mm: int, y_mm: int) -> int:
    return int(evidence.score[evidence.index(x_mm, y_mm)])


def test_near_echo_is_certain_after_two_looks() -> None:
    evidence, ring = grid(), ring_with({3: 0.10})
    update_evidence(evidence, 0, 0, 128, ring, RADIUS_MM)
    assert MAYBE <= at(evidence, AHEAD_MM, 0) < SURE
    update_evidence(evidence, 0, 0, 128, ring, RADIUS_MM)
    assert at(evidence, AHEAD_MM, 0) >= SURE
    assert at(evidence, AHEAD_MM - 60, 0) < 0


def test_far_echo_stays_doubtful() -> None:
    evidence, ring = grid(), ring_with({3: 1.2})
    for _ in range(30):
        update_evidence(evidence, 0, 0, 128, ring, RADIUS_MM)
    assert at(evidence, 1200 + RADIUS_MM, 0) == MOST_MANY
    assert MOST_MANY < SURE


def test_longer_echo_clears_what_was_occupied() -> None:
    evidence = grid()
    for _ in range(4):
        update_evidence(evidence, 0, 0, 128, ring_with({3: 0.10}), RADIUS_MM)
    assert at(evidence, AHEAD_MM, 0) >= SURE
    for _ in range(30):
        update_evidence(evidence, 0, 0, 128, ring_with({3: inf}), RADIUS_MM)
    assert at(evidence, AHEAD_MM, 0) == LEAST_NEAR


def test_one_lost_echo_does_not_clear_a_wall() -> None:
    evidence = grid()
    for _ in range(4):
        update_evidence(evidence, 0, 0, 128, ring_with({3: 0.10}), RADIUS_MM)
    update_evidence(evidence, 0, 0, 128, ring_with({3: inf}), RADIUS_MM)
    assert at(evidence, AHEAD_MM, 0) >= SURE


def test_missing_measurement_changes_nothing() -> None:
    evidence = grid()
    cells, before = update_evidence(evidence, 0, 0, 0, ring_with({}), RADIUS_MM)
    assert not evidence.score.any()
    assert len(cells) == len(before) == 0


def test_known_obstacle_explains_its_arc() -> None:
    score = np.array([SURE, 0, 0, 0], dtype=np.int16)
    take(score, np.array([0, 1, 2, 3]))
    assert score.tolist() == [SURE + 1, 0, 0, 0]


def test_echo_comes_from_a_cell_that_no_echo_passed() -> None:
    score = np.array([PASSED, 0, PASSED, PASSED], dtype=np.int16)
    for _ in range(6):
        take(score, np.arange(4))
    assert score.tolist() == [PASSED, MOST, PASSED, PASSED]


def test_arc_of_free_cells_is_doubted() -> None:
    score = np.full(4, PASSED, dtype=np.int16)
    take(score, np.arange(4))
    assert (score > PASSED).all()


@each("heading", [0, 700, -3000, 9000])
def test_cells_are_reported_once_with_their_score_before(heading: int) -> None:
    evidence, ring = grid(), ring_with({1: 0.2, 4: 0.3, 6: 0.05}, inf)
    update_evidence(evidence, 30, 50, heading, ring, RADIUS_MM)
    old = evidence.score.copy()
    cells, before = update_evidence(evidence, 30, 50, heading, ring, RADIUS_MM)
    assert len(set(cells.tolist())) == len(cells) > 0
    assert (old[cells] == before).all()
    changed = np.flatnonzero((old >= MAYBE) != (evidence.score >= MAYBE))
    assert set(changed.tolist()) <= set(cells.tolist())
