"""Parts of shrinking: delta debugging, simple values, and rounding."""

from hypothesis import given
from hypothesis import strategies as st

from plant.corpus import generate
from plant.corpus.draft import Axis
from plant.world.writer import dumps
from protocol.world import Circle, Polyline
from study.falsify.shrink import (
    checked,
    parts_of,
    reduce_list,
    replaced,
    roundings,
    simple_values,
    walls_in,
)
from tests.support.each import each


@given(st.sets(st.integers(0, 30), max_size=6), st.integers(1, 31))
def test_reduction_keeps_exactly_what_is_needed(needed: set[int], count: int) -> None:
    items = list(range(count))
    wanted = {one for one in needed if one < count}
    assert set(reduce_list(items, lambda kept: wanted <= set(kept))) == wanted


def test_reduction_ends_where_no_item_can_be_removed_alone() -> None:
    kept = reduce_list(list("abcdef"), lambda some: "c" in some or len(some) == 6)
    assert kept == ["c"]


@each(
    ("axis", "value", "simpler"),
    [
        (Axis("turn_deg", -180.0, 180.0), 12.34, [0.0, 90.0, 45.0, 12.0, 12.3]),
        (Axis("count", 1, 4, whole=True), 3.0, [1.0, 2.0]),
        (Axis("max_speed_m_s", 0.1, 0.5), 0.3333, [0.3, 0.33]),
        (Axis("max_speed_m_s", 0.1, 0.5), 0.3, []),
    ],
)
def test_simple_values_stay_within_the_axis(axis: Axis, value: float, simpler: list[float]) -> None:
    assert list(simple_values(axis, value)) == simpler


def test_rounding_starts_with_the_coarsest_grid() -> None:
    world = generate("three_walls", 0, 3)
    first = next(iter(roundings(world, "goal")))
    assert first.goal.x_m % 0.5 == first.goal.y_m % 0.5 == 0.0
    assert first.start == world.start
    assert first.obstacles == world.obstacles


def test_each_part_is_rounded_alone() -> None:
    world = generate("three_walls", 0, 3)
    assert parts_of(world) == ["all", "size", "start", "goal", *range(len(world.obstacles))]
    for other in roundings(world, 0):
        assert other.obstacles[1:] == world.obstacles[1:]
        assert other.start == world.start


def test_wall_without_length_is_no_valid_world() -> None:
    world = generate("three_walls", 0, 3)
    assert checked(dumps(world)) is not None
    flat = replaced(world, 0, Polyline(((1.0, 1.0), (1.0, 1.0))))
    assert checked(dumps(flat)) is None


def test_walls_are_counted_as_straight_pieces() -> None:
    world = generate("three_walls", 0, 3)
    bent = replaced(world, 0, Polyline(((1.0, 1.0), (2.0, 1.0), (2.0, 2.0))))
    assert walls_in(bent) == walls_in(world) + 1
    post = replaced(world, 0, Circle(x_m=1.0, y_m=1.0, radius_m=0.1))
    assert walls_in(post) == walls_in(world)
