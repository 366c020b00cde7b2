"""Generated worlds: families, properties, seeds, and adversarial vectors."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import combinations, pairwise
from math import dist, isclose, pi
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant import corpus as made
from plant.corpus import (
    ADVERSARIAL_FAMILIES,
    CROWD_FAMILIES,
    EVERY_FAMILY,
    FAMILIES,
    FLEET_FAMILIES,
    GRID_FAMILIES,
    buildings,
    generate,
)
from plant.corpus.adversarial import cut_outline, nearest_first
from plant.corpus.buildings import MAPS, Plan, carved, neighbours, wall_lines
from plant.corpus.draft import ShapeFrame, shifted
from plant.corpus.generate import ADVERSARIAL_MARGIN_M, ADVERSARIES, MARGIN_M, drawn, world_of
from plant.corpus.shapes import CROWD_M_S, HASTY_M_S, MIN_PASSAGE_M, PERSON_M, START_ROOM_M
from plant.corpus.traps import THICKNESSES_M, with_walls
from plant.imports.cells import labelled
from plant.imports.moving_ai import parse_map
from plant.model.configuration import Body
from plant.model.draws import Draws
from plant.model.geometry import clearance_m, movers
from plant.placement import STANDING_M, goals, starts
from plant.shortest_path import shortest_path_m
from plant.world.file import load, loads
from plant.world.writer import dumps
from protocol.world import Point, Polyline, World, WorldCircle
from tests.support.each import each

FIXED_DIR = Path(made.__file__).parent / "fixed"
SOME = 5 if settings().max_examples > 1000 else 3
"""Worlds of each family, by `--examples`."""


@cache
def generated(family: str, index: int, seed: int = 11) -> World:
    return generate(family, index, seed)


def some(family: str, seed: int = 11) -> tuple[World, ...]:
    return tuple(generated(family, index, seed) for index in range(SOME))


def ends(world: World) -> tuple[Point, Point]:
    return (world.start.x_m, world.start.y_m), (world.goal.x_m, world.goal.y_m)


def test_families_suffice_for_450_worlds() -> None:
    assert len(FAMILIES) == len(set(FAMILIES)) == 19
    assert 25 * len(FAMILIES) >= 450
    assert not set(FAMILIES) & {*GRID_FAMILIES, *CROWD_FAMILIES}


def test_corpus_lists_every_family_in_order() -> None:
    worlds = list(made.corpus(per_family=2, seed=7))
    assert [world.family for world in worlds] == [name for name in FAMILIES for _ in range(2)]
    assert len({world.name for world in worlds}) == 2 * len(FAMILIES)
    assert worlds[0] == generate(FAMILIES[0], 0, 7)


@pytest.mark.sweep(3)
@pytest.mark.parametrize("family", [*FAMILIES, *GRID_FAMILIES, *CROWD_FAMILIES])
def test_generated_world_survives_a_round_trip_through_a_file(family: str) -> None:
    for index in range(2 if family in GRID_FAMILIES else SOME):
        world = generated(family, index)
        assert loads(dumps(world)) == world


@each("family", [*FAMILIES, *GRID_FAMILIES, *CROWD_FAMILIES])
def test_family_seed_and_index_determine_the_world(family: str) -> None:
    world = generated(family, 1)
    assert generate(family, 1, 11) == world != generated(family, 0)
    assert generate(family, 1, 12).obstacles != world.obstacles or family == "open"


@each("family", FAMILIES)
def test_start_and_goal_are_clear_of_static_obstacles(family: str) -> None:
    for world in some(family):
        for point in ends(world):
            rim_m = min(*point, world.size_m[0] - point[0], world.size_m[1] - point[1])
            gaps_m = [clearance_m(point, one) for one in world.obstacles]
            assert min([rim_m, *gaps_m]) >= STANDING_M > Body().radius_m


@each("family", [name for name in FAMILIES if name != "unreachable"])
def test_larger_robot_has_a_path_too(family: str) -> None:
    for world in some(family):
        larger = replace(world, robot={"radius_m": Body().radius_m + MARGIN_M})
        assert world.reachable
        assert shortest_path_m(larger) is not None


@each("family", [name for name in FAMILIES if name != "unreachable"])
def test_world_gives_its_shortest_path_to_the_millimetre(family: str) -> None:
    for world in some(family):
        exact_m = shortest_path_m(world)
        assert exact_m is not None
        assert world.shortest_path_m == round(exact_m, 3)
        assert world.shortest_path_m >= dist(*ends(world)) - 1e-3


def test_unreachable_goal_is_on_free_floor_without_a_path() -> None:
    for world in some("unreachable"):
        assert world.reachable is False
        assert world.shortest_path_m is None
        assert shortest_path_m(world) is None


def test_goals_are_unreachable_in_different_ways() -> None:
    kinds = {len(world.obstacles) == 1 for world in some("unreachable") + some("unreachable", 12)}
    assert kinds == {True, False}


def test_half_of_the_goals_have_a_heading() -> None:
    worlds = [world for family in FAMILIES for world in some(family)]
    asking = [world for world in worlds if world.goal.heading_rad is not None]
    assert 0.3 < len(asking) / len(worlds) < 0.7


def test_floors_vary_in_size_and_shapes_in_direction() -> None:
    sizes = {world.size_m for family in FAMILIES for world in some(family)}
    assert len(sizes) > 0.9 * SOME * len(FAMILIES)
    walls = [one for world in some("wall") for one in world.obstacles if isinstance(one, Polyline)]
    assert all(a[0] != b[0] and a[1] != b[1] for wall in walls for a, b in pairwise(wall.points_m))


def test_world_keeps_its_seed_and_its_name_contains_it() -> None:
    world = generate("u_trap", 3, 42)
    assert (world.name, world.family, world.family_seed) == ("u_trap_42_003", "u_trap", 42)


def test_unknown_family_is_rejected_by_name() -> None:
    with pytest.raises(ValueError, match="no family 'u_tarp'; there are open, disc"):
        generate("u_tarp", 0, 1)


def along(walker: WorldCircle) -> Iterator[Point]:
    for a, b in pairwise(walker.path_m):
        yield from (
            (a[0] + (b[0] - a[0]) * i / 40, a[1] + (b[1] - a[1]) * i / 40) for i in range(41)
        )


def test_people_are_slower_than_the_robot_and_leave_it_a_path() -> None:
    room_m = 2.0 * Body().radius_m
    for world in some("moving"):
        walkers = movers(world)
        assert 2 <= len(walkers) <= 4
        still = [one for one in world.obstacles if one not in walkers]
        for walker in walkers:
            assert (walker.radius_m, 0.1 <= walker.speed_m_s <= 0.2) == (0.2, True)
            for point in along(walker):
                gaps_m = [clearance_m(point, one) for one in still]
                gaps_m += [dist(point, end) for end in ends(world)]
                gaps_m += [*point, world.size_m[0] - point[0], world.size_m[1] - point[1]]
                others = [other for other in walkers if other is not walker]
                gaps_m += [dist(point, place) - 0.2 for other in others for place in along(other)]
                assert min(gaps_m) > 0.2 + room_m


def test_committed_worlds_match_the_generator() -> None:
    files = sorted(FIXED_DIR.glob("*.toml"))
    expected = {world.name: world for world in made.corpus(per_family=2, seed=1)}
    assert [file.stem for file in files] == sorted(expected)
    for file in files:
        assert load(file) == expected[file.stem], f"{file.name}: make it anew"


SOME_OF_FAMILIES = range(8)


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
    for index in SOME_OF_FAMILIES:
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
    for index in SOME_OF_FAMILIES:
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
    for index in SOME_OF_FAMILIES:
        world = generate(family, index, 5)
        trunks = [one for one in world.obstacles if isinstance(one, WorldCircle)]
        assert low_m2 < len(trunks) / (world.size_m[0] * world.size_m[1]) < high_m2
        gaps_m = (
            dist((a.x_m, a.y_m), (b.x_m, b.y_m)) - a.radius_m - b.radius_m
            for a, b in combinations(trunks, 2)
        )
        assert min(gaps_m) >= MIN_PASSAGE_M > 2.0 * Body().radius_m


def test_spiral_winds_and_leaves_room_for_the_robot() -> None:
    for index in SOME_OF_FAMILIES:
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
@each("seed", SOME_OF_FAMILIES)
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
        people = [one for one in world.obstacles if isinstance(one, WorldCircle) and one.path_m]
        sizes.add(len(people))
        assert all(speeds_m_s[0] <= one.speed_m_s <= speeds_m_s[1] for one in people)
        for place_m in ((world.start.x_m, world.start.y_m), (world.goal.x_m, world.goal.y_m)):
            for one in people:
                assert min(dist(place_m, at_m) for at_m in one.path_m) >= PERSON_M + START_ROOM_M
    assert sizes == {1, 2, 3, 4, 5, 6}


SOME_ADVERSARIAL = 3
MIDDLE = {
    family: {
        axis.name: float(round((axis.low + axis.high) / 2))
        if axis.whole
        else (axis.low + axis.high) / 2
        for axis in adversary.axes
    }
    for family, adversary in ADVERSARIES.items()
}
"""The middle of each axis."""


@cache
def some_adversarial(family: str) -> tuple[World, ...]:
    return tuple(generate(family, index, 21) for index in range(SOME_ADVERSARIAL))


def length_for(world: World, radius_m: float) -> float | None:
    return shortest_path_m(replace(world, robot={**world.robot, "radius_m": radius_m}))


def test_adversarial_families_are_not_in_the_corpus() -> None:
    others = (*FAMILIES, *GRID_FAMILIES, *CROWD_FAMILIES)
    assert not {*ADVERSARIAL_FAMILIES, *FLEET_FAMILIES} & set(others)
    assert (*others, *ADVERSARIAL_FAMILIES, *FLEET_FAMILIES) == EVERY_FAMILY


@each("family", ADVERSARIAL_FAMILIES)
def test_names_of_axes_are_unique_within_a_family(family: str) -> None:
    names = [axis.name for axis in ADVERSARIES[family].axes]
    assert len(names) == len(set(names))
    assert all(axis.low < axis.high for axis in ADVERSARIES[family].axes)


@each("family", ADVERSARIAL_FAMILIES)
def test_generated_adversary_is_the_same_world_from_its_file(family: str) -> None:
    for world in some_adversarial(family):
        assert loads(dumps(world)) == world


@each("family", ADVERSARIAL_FAMILIES)
def test_reachability_holds_for_slightly_other_robots(family: str) -> None:
    radius_m = Body().radius_m
    for world in some_adversarial(family):
        other_m = radius_m + (ADVERSARIAL_MARGIN_M if world.reachable else -ADVERSARIAL_MARGIN_M)
        assert (length_for(world, other_m) is not None) == world.reachable


@each("family", ["nested_rings", "nested_boxes", "island_room"])
def test_sealed_enclosure_is_unreachable(family: str) -> None:
    world = world_of(family, {**MIDDLE[family], "sealed": 0.0}, "sealed", 1)
    assert world is not None
    assert world.reachable is False


@each("family", ["nested_rings", "hairpin", "comb"])
def test_passages_grow_with_the_robot(family: str) -> None:
    values = {**MIDDLE[family], "sealed": 1.0, "excess_m": 0.05}
    for radius_m in (0.08, 0.2):
        world = world_of(family, values, "wide", 1, {"radius_m": radius_m, "track_m": 0.1})
        assert world is not None
        assert world.reachable


def test_mouth_within_the_margin_makes_no_world() -> None:
    values = {**MIDDLE["hairpin"], "outside": 1.0}
    assert (
        world_of("hairpin", {**values, "mouth_m": 2.4 * ADVERSARIAL_MARGIN_M}, "w", 1) is not None
    )
    assert world_of("hairpin", {**values, "mouth_m": 1.6 * ADVERSARIAL_MARGIN_M}, "w", 1) is None
    assert (
        world_of("hairpin", {**values, "mouth_m": -2.4 * ADVERSARIAL_MARGIN_M}, "w", 1) is not None
    )


@each("family", ADVERSARIAL_FAMILIES)
def test_drawn_values_are_within_their_axes(family: str) -> None:
    values = drawn(Draws(family), ADVERSARIES[family].axes)
    for axis in ADVERSARIES[family].axes:
        assert axis.low <= values[axis.name] <= axis.high
        assert not axis.whole or values[axis.name].is_integer()


def test_each_long_detour_is_over_ten_times_the_straight_line() -> None:
    for index in range(6):
        world = generate("long_detour", index, 21)
        assert world.shortest_path_m is not None
        straight_m = dist((world.start.x_m, world.start.y_m), (world.goal.x_m, world.goal.y_m))
        assert world.shortest_path_m >= 10.0 * straight_m


def test_shorter_detour_makes_no_world() -> None:
    values = {**MIDDLE["long_detour"], "near_m": 0.4, "hook": 0.0}
    assert world_of("long_detour", {**values, "up_m": 8.0, "down_m": 8.0}, "w", 1) is not None
    assert world_of("long_detour", {**values, "up_m": 8.0, "down_m": 2.0}, "w", 1) is None


def test_cells_of_a_maze_are_in_the_order_of_their_paths() -> None:
    """A corridor of three cells, and a side cell at the second of them."""
    doors = {frozenset(pair) for pair in (((0, 0), (1, 0)), ((1, 0), (2, 0)), ((1, 0), (1, 1)))}
    doors |= {frozenset(((1, 1), (0, 1)))}
    assert nearest_first((2, 0), 3, 2, doors) == [(2, 0), (1, 0), (0, 0), (1, 1), (0, 1)]


def test_path_through_a_long_maze_passes_many_cells() -> None:
    values = {**MIDDLE["long_maze"], "far": 1.0}
    world = world_of("long_maze", values, "w", 1)
    assert world is not None
    assert world.shortest_path_m is not None
    cell_m = 2.0 * Body().radius_m + values["excess_m"] + values["thickness_m"]
    assert world.shortest_path_m > 25 * cell_m


def test_scene_of_three_walls_has_at_most_three_walls() -> None:
    for world in some_adversarial("three_walls"):
        assert 1 <= len(world.obstacles) <= 3
        assert all(isinstance(one, Polyline) and len(one.points_m) == 2 for one in world.obstacles)


@each("share", [0.0, 0.1, 0.25, 0.6, 0.99])
def test_cut_outline_lacks_exactly_its_gap(share: float) -> None:
    square = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]
    line = cut_outline(square, share, 0.5)
    assert isclose(sum(dist(a, b) for a, b in pairwise(line)), 7.5)


def test_outline_shorter_than_its_gap_is_empty() -> None:
    assert cut_outline([(0.0, 0.0), (0.1, 0.0), (0.1, 0.1)], 0.5, 0.5) == []


def test_points_that_fall_on_one_another_become_one() -> None:
    beside = (0.3, 0.3004)
    moved = shifted(Polyline(((0.0, 0.0), (0.3, 0.3), beside, (0.0, 0.0))), (1.0, 0.0))
    assert moved == Polyline(((1.0, 0.0), (1.3, 0.3), (1.0, 0.0)))


@each("index", [0, 1, 2])
def test_warehouse_has_room_for_a_hundred_robots_and_goals(index: int) -> None:
    world = generate("warehouse", index, 1)
    assert world.reachable
    places = starts(world, Body(), 100)
    ends_at = goals(world, Body(), places, (world.goal.x_m, world.goal.y_m))
    assert len({(one.x_m, one.y_m) for one in ends_at}) == 100
    assert all(one.shifted for one in ends_at)
    assert loads(dumps(world)) == world
