"""Generated worlds: each has the properties of its family, and equal seeds give equal worlds."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import dist
from pathlib import Path

import pytest
from hypothesis import settings

from plant import corpus as made
from plant.corpus import CROWD_FAMILIES, FAMILIES, GRID_FAMILIES, generate
from plant.corpus.draft import STANDING_M
from plant.corpus.generate import MARGIN_M
from plant.model.configuration import Body
from plant.model.geometry import clearance_m, movers
from plant.shortest_path import shortest_path_m
from plant.world.file import load, loads
from plant.world.writer import dumps
from protocol.world import Circle, Point, Polyline, World
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


def along(walker: Circle) -> Iterator[Point]:
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
