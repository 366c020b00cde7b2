from collections import deque
from math import hypot

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from plant.imports.cells import Cells, Mask, labelled, standing
from plant.model.draws import Draws

masks = hnp.arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9)))


def flooded(mask: Mask, row: int, column: int) -> set[tuple[int, int]]:
    """Return the connected region of a mask around a cell, by a slow flood fill."""
    reached, todo = {(row, column)}, deque([(row, column)])
    while todo:
        r, c = todo.popleft()
        for there in ((r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)):
            inside = 0 <= there[0] < mask.shape[0] and 0 <= there[1] < mask.shape[1]
            if inside and mask[there] and there not in reached:
                reached.add(there)
                todo.append(there)
    return reached


@given(masks)
def test_connected_cells_share_one_label(mask: Mask) -> None:
    labels = labelled(mask)
    assert ((labels > 0) == mask).all()
    assert set(labels[mask].tolist()) == set(range(1, labels.max(initial=0) + 1))
    for row, column in np.argwhere(mask).tolist():
        same = {(r, c) for r, c in np.argwhere(labels == labels[row, column]).tolist()}
        assert same == flooded(mask, row, column)


@given(masks, st.floats(0.0, 2.5))
def test_place_is_clear_far_from_blocked_cells_and_rim(mask: Mask, room_m: float) -> None:
    clear = standing(Cells(mask, 1.0), room_m)
    blocked = np.argwhere(np.pad(mask, 4, constant_values=True)) - 4
    for row, column in np.ndindex(mask.shape):
        gaps_m = [
            hypot(max(0.0, abs(row - r) - 0.5), max(0.0, abs(column - c) - 0.5))
            for r, c in blocked.tolist()
        ]
        expected = not mask[row, column] and min(gaps_m) >= room_m - 1e-9
        assert clear[row, column] == expected


@given(masks)
def test_trimming_keeps_all_free_cells_in_place(mask: Mask) -> None:
    whole = Cells(mask, 0.5, corner=(10.0, 20.0), yaw_rad=0.3)
    part = whole.trimmed()
    assert (~part.blocked).sum() == (~mask).sum()
    if mask.all():
        return
    for rim in (part.blocked[0], part.blocked[-1], part.blocked[:, 0], part.blocked[:, -1]):
        assert not rim.all()
    # A free cell is at the same place of the map's frame as before.
    row, column = np.argwhere(~part.blocked)[0].tolist()
    x_m, y_m = part.centre(row, column)
    c, s = np.cos(0.3), np.sin(0.3)
    place = (part.corner[0] + c * x_m - s * y_m, part.corner[1] + s * x_m + c * y_m)
    old_x, old_y = whole.on_floor(place)
    assert not mask[int(old_y / 0.5), int(old_x / 0.5)]
    assert np.allclose(part.on_floor(place), (x_m, y_m), atol=2e-6)


@given(masks, st.integers(1, 12), st.integers(0, 99))
def test_window_is_a_part_of_the_map(mask: Mask, side: int, seed: int) -> None:
    whole = Cells(mask, 1.0)
    part = whole.window(Draws(str(seed)), side)
    assert part.blocked.shape == (min(side, whole.rows), min(side, whole.columns))
    column, row = (round(value) for value in part.corner)
    expected = mask[row : row + part.rows, column : column + part.columns]
    assert (part.blocked == expected).all()


@settings(max_examples=30)
@given(masks, st.integers(1, 4))
def test_finer_cells_cover_the_same_floor(mask: Mask, parts: int) -> None:
    fine = Cells(mask, 0.6).finer(parts)
    assert fine.size_m == Cells(mask, 0.6).size_m
    assert (fine.blocked[::parts, ::parts] == mask).all()
    assert fine.blocked.sum() == mask.sum() * parts**2
