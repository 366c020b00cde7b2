"""The shape of each family of worlds."""

from itertools import combinations, pairwise
from math import dist, isclose, pi

from hypothesis import given
from hypothesis import strategies as st

from plant.corpus import CROWD_FAMILIES, GRID_FAMILIES, buildings, generate
from plant.corpus.buildings import MAPS, Plan, carved, neighbours, wall_lines
from plant.corpus.draft import ShapeFrame
from plant.corpus.shapes import CROWD_M_S, HASTY_M_S, MIN_PASSAGE_M, PERSON_M, START_ROOM_M
from plant.corpus.traps import THICKNESSES_M, with_walls
from plant.imports.cells import labelled
from plant.imports.moving_ai import parse_map
from plant.model.configuration import Body
from plant.model.draws import Draws
from protocol.world import Circle, Polyline, World
from tests.support.each import each

SOME = range(8)


def walls_of(world: World) -> list[Polyline]:
    return [one for one in world.obstacles if isinstance(one, Polyline)]


@given(st.floats(-pi, pi), st.floats(-3, 3), st.floats(-3, 3), st.sampled_from((-1, 1)))
def test_frame_preserves_distances_when_turned_or_mirrored(
    angle_rad: float, along_m: float, left_m: float, hand: int
) -> None:
    frame = ShapeFrame((1.0, 2.0), angle_rad, hand)
    assert isclose(
        dist(frame.point(0.0, 0.0), frame.point(along_m, left_m)),
        dist((0.0, 0.0), (along_m, left_m)),
        abs_tol=0.002,
    )


def test_traps_vary_in_size_and_open_towards_the_start() -> None:
    for index in SOME:
        world = generate("u_trap", index, 5)
        (trap,) = walls_of(world)
        near_left, far_left, far_right, near_right = trap.points_m
        start = (world.start.x_m, world.start.y_m)
        goal = (world.goal.x_m, world.goal.y_m)
        assert 0.59 <= dist(far_left, far_right) <= 2.01
        assert 0.59 <= dist(near_left, far_left) <= 1.61
        assert isclose(dist(near_left, far_left), dist(near_right, far_right), abs_tol=0.01)
        assert dist(start, goal) > 1.0


def test_door_is_wide_enough_and_the_only_passage_of_its_wall() -> None:
    for index in SOME:
        world = generate("door", index, 5)
        walls = walls_of(world)
        for left, right in zip(walls[::2], walls[1::2], strict=True):
            gap_m = dist(left.points_m[0], right.points_m[0]) - left.thickness_m
            assert 0.399 <= gap_m <= 0.601
            for wall in (left, right):
                x_m, y_m = wall.points_m[1]
                assert not (0.0 <= x_m <= world.size_m[0] and 0.0 <= y_m <= world.size_m[1])


@each(
    ("family", "low_m2", "high_m2"),
    [
        ("forest_sparse", 0.2, 0.5),
        ("forest_medium", 0.55, 0.9),
        ("forest_dense", 1.0, 1.35),
    ],
)
def test_forest_has_its_density_and_passages_between_trunks(
    family: str, low_m2: float, high_m2: float
) -> None:
    for index in SOME:
        world = generate(family, index, 5)
        trunks = [one for one in world.obstacles if isinstance(one, Circle)]
        assert low_m2 < len(trunks) / (world.size_m[0] * world.size_m[1]) < high_m2
        gaps_m = (
            dist((a.x_m, a.y_m), (b.x_m, b.y_m)) - a.radius_m - b.radius_m
            for a, b in combinations(trunks, 2)
        )
        assert min(gaps_m) >= MIN_PASSAGE_M > 2.0 * Body().radius_m


def test_spiral_winds_and_leaves_room_for_the_robot() -> None:
    for index in SOME:
        (wall,) = walls_of(generate("spiral", index, 5))
        legs_m = [dist(a, b) for a, b in pairwise(wall.points_m)]
        assert 4 <= len(legs_m) <= 9
        assert all(b > 0.99 * a for a, b in pairwise(legs_m))
        assert legs_m[0] - wall.thickness_m > 2.0 * Body().radius_m + 0.1


def test_thin_worlds_have_walls_of_one_of_three_thicknesses() -> None:
    seen = set()
    for index in range(12):
        thicknesses_m = {wall.thickness_m for wall in walls_of(generate("thin", index, 5))}
        assert len(thicknesses_m) == 1
        seen |= thicknesses_m
    assert seen == set(THICKNESSES_M) == {0.002, 0.005, 0.010}


def test_thin_walls_stand_where_those_of_the_draft_stand() -> None:
    draft = buildings.office(Draws("thin"))
    thin = with_walls(draft, 0.005)
    assert thin.start == draft.start
    for one, other in zip(draft.obstacles, thin.obstacles, strict=True):
        if isinstance(one, Polyline) and isinstance(other, Polyline):
            assert other.points_m == one.points_m
            assert other.thickness_m == 0.005
        else:
            assert other == one


@given(st.integers(1, 7), st.integers(1, 7), st.integers(0, 1000))
def test_carved_building_is_a_spanning_tree_when_it_has_no_loops(
    columns: int, rows: int, seed: int
) -> None:
    doors = carved(Draws(str(seed)), columns, rows, 0.0)
    assert len(doors) == columns * rows - 1
    reached, todo = {(0, 0)}, [(0, 0)]
    while todo:
        here = todo.pop()
        for there in neighbours(here, columns, rows):
            if frozenset((here, there)) in doors and there not in reached:
                reached.add(there)
                todo.append(there)
    assert len(reached) == columns * rows


@given(st.integers(2, 7), st.integers(2, 7), st.integers(0, 1000))
def test_maze_wall_length_equals_length_of_closed_borders(
    columns: int, rows: int, seed: int
) -> None:
    doors = carved(Draws(str(seed)), columns, rows, 0.1)
    borders = columns * (rows - 1) + rows * (columns - 1)
    lines = wall_lines(Plan(columns, rows, (1.0, 1.0), doors))
    assert isclose(sum(dist(a, b) for a, b in lines), borders - len(doors))
    assert len(lines) <= borders - len(doors)


@each("family", GRID_FAMILIES)
@each("seed", SOME)
def test_grid_map_has_the_requested_size(family: str, seed: int) -> None:
    cells = parse_map(MAPS[family](Draws(str(seed))), "test.map", 0.4)
    assert 20 <= min(cells.rows, cells.columns) <= max(cells.rows, cells.columns) <= 32
    share = cells.blocked.mean()
    assert (0.09 < share < 0.36) if family == "grid_random" else 0.1 < share < 0.8
    if family != "grid_random":
        assert labelled(~cells.blocked).max() == 1


@each("family", GRID_FAMILIES)
def test_grid_world_has_a_path_to_its_goal(family: str) -> None:
    for index in range(3):
        world = generate(family, index, 9)
        start, goal = (world.start.x_m, world.start.y_m), (world.goal.x_m, world.goal.y_m)
        assert world.reachable
        assert world.shortest_path_m is not None
        assert world.shortest_path_m > dist(start, goal) - 1e-3 > 1.0


@each(("family", "speeds_m_s"), [("crowd", CROWD_M_S), ("crowd_hasty", HASTY_M_S)])
def test_crowd_has_one_to_six_people_of_its_speeds(
    family: str, speeds_m_s: tuple[float, float]
) -> None:
    assert family in CROWD_FAMILIES
    sizes = set()
    for index in range(24):
        world = generate(family, index, 5)
        people = [one for one in world.obstacles if isinstance(one, Circle) and one.path_m]
        sizes.add(len(people))
        assert all(speeds_m_s[0] <= one.speed_m_s <= speeds_m_s[1] for one in people)
        for place_m in ((world.start.x_m, world.start.y_m), (world.goal.x_m, world.goal.y_m)):
            for one in people:
                assert min(dist(place_m, at_m) for at_m in one.path_m) >= PERSON_M + START_ROOM_M
    assert sizes == {1, 2, 3, 4, 5, 6}
