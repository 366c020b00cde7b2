"""Maps of cells: rectangles, outlines and shortest routes."""

from collections import deque
from heapq import heappop, heappush
from itertools import pairwise
from math import asin, atan2, ceil, dist, hypot, inf, sqrt

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from plant.corpus import FAMILIES, GRID_FAMILIES, generate
from plant.imports.cells import MAX_POINTS, Cells, Mask, labelled, outlines, standing
from plant.imports.importer import ImportedWorld, Places, grid_world
from plant.model.configuration import Body
from plant.model.draws import Draws
from plant.model.geometry import area_m2, clearance_m, crossing_edges, folded_corner, inside, moves
from plant.shortest_path import near_path, shortest_path_m
from protocol.world import Point, World
from tests.support.each import each

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


RADIUS_M = Body().radius_m
PITCH_M = 0.07
MOVES = [(x, y, hypot(x, y)) for x in (-1, 0, 1) for y in (-1, 0, 1) if (x, y) != (0, 0)]
LONGER = 1.0824


def room_of_nodes(world: World) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Return the room around each node, up to more than any robot here needs."""
    columns, rows = (ceil(side / PITCH_M) + 1 for side in world.size_m)
    still = [one for one in world.obstacles if not moves(one)]
    room_m = np.zeros((columns, rows))
    for column, row in np.ndindex(columns, rows):
        x_m, y_m = column * PITCH_M, row * PITCH_M
        rim_m = min(x_m, y_m, world.size_m[0] - x_m, world.size_m[1] - y_m)
        room_m[column, row] = min(
            [rim_m, *(clearance_m((x_m, y_m), one) for one in still)] if rim_m > 0.0 else [rim_m]
        )
    return room_m


def grid_length_m(world: World, free: Mask) -> float:
    """Return the length over free nodes nearest to start and goal; inf when there is no way."""
    first, last = (
        (round(end.x_m / PITCH_M), round(end.y_m / PITCH_M)) for end in (world.start, world.goal)
    )
    nodes = set(map(tuple, np.argwhere(free).tolist()))
    cost, todo = {first: 0.0}, [(0.0, first)]
    while todo:
        here_cost, here = heappop(todo)
        if here == last:
            return here_cost * PITCH_M
        for x, y, step in MOVES:
            there = here[0] + x, here[1] + y
            if there not in nodes:
                continue
            there_cost = here_cost + step
            if there_cost < cost.get(there, inf):
                cost[there] = there_cost
                heappush(todo, (there_cost, there))
    return inf


@pytest.mark.sweep(4)
@pytest.mark.parametrize("family", [name for name in FAMILIES if name != "forest_dense"])
def test_exact_path_is_not_longer_than_a_fine_grid_path(
    family: str,
) -> None:
    world = generate(family, 2, 31)
    # Room for what lies between two nodes; a passage may be lost to it, but no way is made up.
    room_m = room_of_nodes(world)
    safe_m, bold_m = (
        grid_length_m(world, room_m >= RADIUS_M + spare_m) for spare_m in (0.01, -0.03)
    )
    if world.reachable:
        assert world.shortest_path_m is not None
        assert world.shortest_path_m <= safe_m + 2 * PITCH_M
        assert world.shortest_path_m >= bold_m / LONGER - 2 * PITCH_M
    else:
        assert safe_m == inf


@each("family", GRID_FAMILIES)
def test_path_over_cells_matches_the_exact_search(family: str) -> None:
    world = generate(family, {"grid_maze": 2, "grid_rooms": 3, "grid_random": 0}[family], 1)
    exact_m = shortest_path_m(world)
    assert exact_m is not None
    assert world.shortest_path_m is not None
    assert exact_m - 2e-3 <= world.shortest_path_m <= 1.028 * exact_m


def cells_of(*rows: str) -> Cells:
    """Return the cells of a drawing whose first row is the top."""
    return Cells(np.array([[one == "#" for one in row] for row in rows[::-1]]), 0.4)


def world_of(cells: Cells, start: Point, goal: Point) -> World:
    made = ImportedWorld(file="x.map", name="x", family="test", seed=1, start=start, goal=goal)
    return grid_world(cells, made, Draws("1"))


def test_passage_of_one_cell_is_open() -> None:
    cells = cells_of("...#...", "...#...", ".......", "...#...")
    world = world_of(cells, (0.6, 0.2), (2.2, 0.2))
    assert world.reachable
    # Tangent to a corner, round it, along to the next, round it, tangent to the goal.
    tangent_m, turn_rad = sqrt(0.6**2 + 0.2**2 - RADIUS_M**2), atan2(0.2, 0.6) + asin(0.12 / 0.6325)
    exact_m = 2.0 * (tangent_m + RADIUS_M * turn_rad) + 0.4
    assert world.shortest_path_m == pytest.approx(exact_m, rel=0.006)


def test_diagonal_gap_between_blocked_cells_is_closed() -> None:
    cells = cells_of("..#.", "..#.", "##..", "....")
    world = world_of(cells, (0.2, 1.4), (1.4, 1.4))
    assert (world.reachable, world.shortest_path_m) == (False, None)
    assert shortest_path_m(world) is None


def test_room_too_narrow_for_the_robot_is_closed() -> None:
    narrow = cells_of("......", "##.###", "......")._replace(cell_m=0.23)
    world = world_of(narrow._replace(blocked=narrow.finer(3).blocked), (0.4, 0.3), (0.4, 1.7))
    assert world.reachable
    tight = Cells(narrow.finer(3).blocked, 0.23 / 3)
    assert Places(tight, RADIUS_M).way((0.5, 0.115), (0.5, 0.575)) is None


def test_straight_path_over_cells_is_straight() -> None:
    world = world_of(Cells(np.zeros((20, 30), dtype=bool), 0.4), (1.0, 1.0), (10.0, 6.3))
    assert world.shortest_path_m == round(dist((1.0, 1.0), (10.0, 6.3)), 3)


@pytest.mark.sweep(3)
@pytest.mark.parametrize("seed", range(6))
def test_path_over_cells_touches_no_obstacle(seed: int) -> None:
    mask = np.random.default_rng(seed).random((24, 24)) < 0.25
    made = ImportedWorld(file="x.map", name="x", family="test", seed=seed)
    world = grid_world(Cells(mask, 0.4), made, Draws(str(seed)))
    ends = (world.start.x_m, world.start.y_m), (world.goal.x_m, world.goal.y_m)
    way = Places(Cells(mask, 0.4), RADIUS_M).way(*ends)
    assert way is not None
    path = near_path(world, way, RADIUS_M)
    assert (path[0], path[-1]) == ends
    for a, b in pairwise(path):
        for i in range(21):
            point = (a[0] + (b[0] - a[0]) * i / 20, a[1] + (b[1] - a[1]) * i / 20)
            gap_m = min(clearance_m(point, one) for one in world.obstacles)
            assert gap_m >= RADIUS_M - 1e-5
    length_m = sum(dist(a, b) for a, b in pairwise(path))
    assert length_m <= sum(dist(a, b) for a, b in pairwise(way)) + 1e-9
    assert world.shortest_path_m == round(length_m, 3)
