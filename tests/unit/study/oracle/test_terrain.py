"""Costs of cells from counts of obstacles."""

import numpy as np

from study.oracle.grid_map import (
    BLOCKED_MM,
    CLOSE,
    DOUBTFUL,
    FREE,
    MOST,
    SURE,
    CellEvidence,
    Terrain,
    change,
    price_all,
    terrain_of,
)

SIDE = 100


def grid() -> CellEvidence:
    return CellEvidence(0, 0, SIDE, SIDE)


def costs(terrain: Terrain) -> list[list[int]]:
    found: list[list[int]] = terrain.costs.reshape(terrain.height, terrain.width).tolist()
    return found


def test_certain_obstacle_blocks_a_disc_around_it() -> None:
    evidence = grid()
    evidence.score[50 * SIDE + 50] = SURE
    rows = costs(terrain_of(evidence))
    assert rows[25][25] == rows[25][25 + BLOCKED_MM // 40] == 0
    assert rows[25][29] == FREE + CLOSE
    assert rows[25][32] == FREE


def test_doubtful_obstacle_costs_more() -> None:
    evidence = grid()
    evidence.score[50 * SIDE + 50] = SURE - 1
    rows = costs(terrain_of(evidence))
    assert rows[25][25] == FREE + DOUBTFUL
    assert rows[25][29] == FREE


def test_rim_is_blocked() -> None:
    rows = costs(Terrain(grid()))
    assert not any(rows[0] + rows[-1] + [row[0] for row in rows] + [row[-1] for row in rows])


def test_narrowest_passage_is_open_wherever_it_lies() -> None:
    for shift in range(4):
        evidence = grid()
        scores = evidence.score.reshape(SIDE, SIDE)
        scores[10:90, 30 + shift] = scores[10:90, 30 + shift + 15] = MOST
        row = costs(terrain_of(evidence))[25]
        assert any(row[16 + shift // 2 : 23 + shift // 2])


def test_changes_equal_a_new_count() -> None:
    evidence = grid()
    terrain = terrain_of(evidence)
    cells = np.array([50 * SIDE + 50, 50 * SIDE + 51, 31 * SIDE + 40])
    for scores in ([SURE, 1, MOST], [0, SURE, 1], [1, 0, 0]):
        before = evidence.score[cells]
        evidence.score[cells] = scores
        assert change(terrain, evidence, cells, before)
        price_all(terrain)
        assert costs(terrain) == costs(terrain_of(evidence))
    assert not change(terrain, evidence, cells, evidence.score[cells])
