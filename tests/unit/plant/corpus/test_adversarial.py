"""Adversarial families: functions of a vector, valid as files, with a margin of reachability."""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import dist, isclose

from plant.corpus import (
    ADVERSARIAL_FAMILIES,
    CROWD_FAMILIES,
    EVERY_FAMILY,
    FAMILIES,
    GRID_FAMILIES,
    generate,
)
from plant.corpus.adversarial import cut_outline, nearest_first
from plant.corpus.draft import shifted
from plant.corpus.generate import ADVERSARIAL_MARGIN_M, ADVERSARIES, drawn, world_of
from plant.model.configuration import Body
from plant.model.draws import Draws
from plant.shortest_path import shortest_path_m
from plant.world.file import loads
from plant.world.writer import dumps
from protocol.world import Polyline, World
from tests.support.each import each

SOME = 3
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
def some(family: str) -> tuple[World, ...]:
    return tuple(generate(family, index, 21) for index in range(SOME))


def length_for(world: World, radius_m: float) -> float | None:
    return shortest_path_m(replace(world, robot={**world.robot, "radius_m": radius_m}))


def test_adversarial_families_are_not_in_the_corpus() -> None:
    others = (*FAMILIES, *GRID_FAMILIES, *CROWD_FAMILIES)
    assert not set(ADVERSARIAL_FAMILIES) & set(others)
    assert (*others, *ADVERSARIAL_FAMILIES) == EVERY_FAMILY


@each("family", ADVERSARIAL_FAMILIES)
def test_names_of_axes_are_unique_within_a_family(family: str) -> None:
    names = [axis.name for axis in ADVERSARIES[family].axes]
    assert len(names) == len(set(names))
    assert all(axis.low < axis.high for axis in ADVERSARIES[family].axes)


@each("family", ADVERSARIAL_FAMILIES)
def test_generated_adversary_is_the_same_world_from_its_file(family: str) -> None:
    for world in some(family):
        assert loads(dumps(world)) == world


@each("family", ADVERSARIAL_FAMILIES)
def test_reachability_holds_for_slightly_other_robots(family: str) -> None:
    radius_m = Body().radius_m
    for world in some(family):
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
    for world in some("three_walls"):
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
