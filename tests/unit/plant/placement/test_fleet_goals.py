"""Goals of several robots: shifted like their starts, free for the robot, and apart."""

from itertools import combinations
from math import dist

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.model.configuration import Body, body_of
from plant.placement import RobotGoal, goals, starts
from plant.world.file import load, shipped
from protocol.world import Circle, Obstacle, Point, Polygon
from tests.support.each import each
from tests.support.plant.rooms import room


def gone_to(robots: int, goal: Point, *obstacles: Obstacle) -> list[RobotGoal]:
    world = room(*obstacles)
    return goals(world, Body(), starts(world, Body(), robots), goal)


def test_each_goal_is_shifted_like_its_start() -> None:
    found = gone_to(3, (3.0, 2.0))
    assert [one[:2] for one in found] == [
        pytest.approx((3.0, 2.0)),
        pytest.approx((3.0, 2.6)),
        pytest.approx((3.0, 1.4)),
    ]
    assert all(one.shifted for one in found)


def test_first_goal_is_always_the_goal_of_the_world() -> None:
    assert gone_to(1, (-5.0, 9.0)) == [RobotGoal(-5.0, 9.0, True)]


def test_goal_outside_moves_to_the_nearest_place_inside() -> None:
    first, above, below = gone_to(3, (3.0, 3.8))
    assert not above.shifted
    assert above[:2] == pytest.approx((2.4, 3.8))
    assert below == pytest.approx((3.0, 3.2, True))
    assert first[:2] == (3.0, 3.8)


def test_goal_in_an_obstacle_is_moved_beside_it() -> None:
    pillar = Circle(x_m=3.0, y_m=2.6, radius_m=0.1)
    moved = gone_to(2, (3.0, 2.0), pillar)[1]
    assert not moved.shifted
    assert dist(moved[:2], (3.0, 2.6)) > 0.1 + 0.12


def test_goal_behind_a_wall_moves_to_the_near_side() -> None:
    wall = Polygon(((2.0, 2.15), (4.0, 2.15), (4.0, 2.2), (2.0, 2.2)))
    moved = gone_to(2, (3.0, 2.0), wall)[1]
    assert not moved.shifted
    assert moved.y_m < 2.15 - 0.12


def test_moving_obstacles_do_not_displace_goals() -> None:
    passing = Circle(x_m=3.0, y_m=2.6, radius_m=0.1, path_m=((3.0, 2.6), (1.0, 2.6)))
    assert gone_to(2, (3.0, 2.0), passing)[1].shifted


def test_goal_is_shared_when_no_place_is_free() -> None:
    around = Circle(x_m=3.0, y_m=2.0, radius_m=0.5)
    assert gone_to(2, (3.0, 2.0), around)[1] == RobotGoal(3.0, 2.0, False)


@settings(max_examples=30, deadline=None)
@given(x_m=st.floats(0.2, 3.8), y_m=st.floats(0.2, 3.8), robots=st.integers(1, 6))
def test_goals_are_apart_and_inside_the_room(x_m: float, y_m: float, robots: int) -> None:
    found = gone_to(robots, (x_m, y_m))
    assert min((dist(a[:2], b[:2]) for a, b in combinations(found, 2)), default=1.0) > 0.59
    assert all(0.12 <= value_m <= 3.88 for one in found for value_m in one[:2])


@each("name", shipped())
def test_every_world_has_a_goal_for_a_second_robot(name: str) -> None:
    world = load(name)
    body = body_of(world)
    first, second = goals(world, body, starts(world, body, 2), (world.goal.x_m, world.goal.y_m))
    assert dist(first[:2], second[:2]) > 2.0 * body.radius_m
