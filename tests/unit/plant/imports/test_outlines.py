import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from plant.imports.cells import MAX_POINTS, Cells, Mask, outlines
from plant.model.geometry import area_m2, crossing_edges, folded_corner, inside

masks = hnp.arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9)))
RING = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], dtype=bool)
PINCHED = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 0]], dtype=bool)


@settings(max_examples=200, deadline=None)
@given(masks)
@example(RING)
@example(PINCHED)
@example(PINCHED[::-1])
@example(np.kron(RING, RING).astype(bool))
def test_outlines_cover_exactly_the_blocked_cells(mask: Mask) -> None:
    polygons = outlines(Cells(mask, 1.0))
    assert sum(area_m2(one.points_m) for one in polygons) == pytest.approx(mask.sum())
    for row, column in np.ndindex(mask.shape):
        covering = sum(inside((column + 0.5, row + 0.5), one.points_m) for one in polygons)
        assert covering == mask[row, column]


@settings(max_examples=200, deadline=None)
@given(masks)
@example(PINCHED)
def test_each_outline_is_valid_in_a_world(mask: Mask) -> None:
    for polygon in outlines(Cells(mask, 0.4)):
        assert 4 <= len(polygon.points_m) <= MAX_POINTS
        assert crossing_edges(polygon.points_m) is None
        assert folded_corner(polygon.points_m) is None


def test_block_is_one_polygon_of_four_points() -> None:
    (polygon,) = outlines(Cells(np.ones((40, 60), dtype=bool), 0.05))
    assert set(polygon.points_m) == {(0.0, 0.0), (3.0, 0.0), (3.0, 2.0), (0.0, 2.0)}


def test_hole_needs_one_cut() -> None:
    mask = np.ones((9, 9), dtype=bool)
    mask[3:6, 3:6] = False
    assert len(outlines(Cells(mask, 1.0))) == 2


def test_blocks_meeting_at_a_corner_give_two_touching_polygons() -> None:
    first, second = outlines(Cells(np.eye(2, dtype=bool), 1.0))
    assert set(first.points_m) & set(second.points_m) == {(1.0, 1.0)}


def test_outline_with_too_many_points_is_split() -> None:
    mask = np.ones((2, 101), dtype=bool)
    mask[1, ::2] = False
    polygons = outlines(Cells(mask, 1.0))
    assert max(len(one.points_m) for one in polygons) <= MAX_POINTS
    assert sum(area_m2(one.points_m) for one in polygons) == mask.sum()
