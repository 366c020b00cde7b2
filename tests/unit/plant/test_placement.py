"""Places of starts and goals, for a fleet and for a run that begins elsewhere."""

from dataclasses import replace
from itertools import combinations, pairwise
from math import acos, dist, hypot, inf, isclose, nan, pi, sqrt
from time import thread_time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.model.configuration import LEVELS, Body, body_of
from plant.model.geometry import clearance_m
from plant.placement import RobotGoal, goals, starts
from plant.shortest_path import shortest_path, shortest_path_m
from plant.sim.simulation import Plant
from plant.world.file import load, shipped
from protocol.world import (
    GoalPose,
    Obstacle,
    Point,
    Polyline,
    Start,
    World,
    WorldCircle,
    WorldPolygon,
)
from runtime.errors import UserError
from study.cli.trial import elsewhere
from tests.support.each import each
from tests.support.plant import plain_world, room


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
    pillar = WorldCircle(x_m=3.0, y_m=2.6, radius_m=0.1)
    moved = gone_to(2, (3.0, 2.0), pillar)[1]
    assert not moved.shifted
    assert dist(moved[:2], (3.0, 2.6)) > 0.1 + 0.12


def test_goal_behind_a_wall_moves_to_the_near_side() -> None:
    wall = WorldPolygon(((2.0, 2.15), (4.0, 2.15), (4.0, 2.2), (2.0, 2.2)))
    moved = gone_to(2, (3.0, 2.0), wall)[1]
    assert not moved.shifted
    assert moved.y_m < 2.15 - 0.12


def test_moving_obstacles_do_not_displace_goals() -> None:
    passing = WorldCircle(x_m=3.0, y_m=2.6, radius_m=0.1, path_m=((3.0, 2.6), (1.0, 2.6)))
    assert gone_to(2, (3.0, 2.0), passing)[1].shifted


def test_goal_is_shared_when_no_place_is_free() -> None:
    around = WorldCircle(x_m=3.0, y_m=2.0, radius_m=0.5)
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


ROLLER = WorldCircle(x_m=2.0, y_m=1.0, radius_m=0.2, path_m=((2.0, 1.0), (2.0, 3.0)), speed_m_s=0.5)
BOX = WorldPolygon(((1.0, 1.0), (1.5, 1.0), (1.5, 1.5), (1.0, 1.5)))
FENCE = Polyline(((3.0, 1.0), (3.0, 3.0)))


def at(x_m: float, y_m: float) -> Start:
    return Start(x_m=x_m, y_m=y_m)


def test_relocate_without_changes_returns_the_same_world() -> None:
    world = room(ROLLER)
    assert elsewhere(world, None, None, 0.0) == world


def test_start_and_goal_are_replaced_and_the_rest_kept() -> None:
    world = room(BOX)
    moved = elsewhere(world, at(3.0, 3.0), GoalPose(x_m=0.5, y_m=0.5), 4.0)
    assert (moved.start, moved.goal) == (at(3.0, 3.0), GoalPose(x_m=0.5, y_m=0.5))
    assert moved.obstacles == world.obstacles


@each(
    ("obstacle", "place", "reason"),
    [
        (BOX, (1.2, 1.2), "obstacle#1 is 0.000 m"),
        (BOX, (0.95, 1.2), "obstacle#1 is 0.050 m"),
        (FENCE, (3.05, 2.0), "obstacle#1 is 0.040 m"),
        (ROLLER, (2.0, 1.1), "obstacle#1 is 0.000 m"),
        (BOX, (0.05, 2.0), "the outer wall is 0.050 m"),
        (BOX, (-1.0, 2.0), "outside the world"),
        (BOX, (1.0, 99.0), "outside the world"),
        (BOX, (nan, 2.0), "finite"),
        (BOX, (1.0, inf), "finite"),
    ],
)
def test_blocked_start_is_rejected_with_the_reason(
    obstacle: WorldCircle | WorldPolygon | Polyline, place: tuple[float, float], reason: str
) -> None:
    with pytest.raises(UserError, match="start") as refused:
        elsewhere(room(obstacle), at(*place), None, 0.0)
    assert reason in str(refused.value)


def test_start_in_contact_with_an_obstacle_is_allowed() -> None:
    radius_m = 0.12
    against = at(BOX.points_m[0][0] - radius_m + 0.004, 1.2)
    assert elsewhere(room(BOX), against, None, 0.0).start == against


def test_moving_obstacle_blocks_only_its_current_position() -> None:
    """Place the obstacle where it is after 4 s: two metres up, at the end of its path."""
    world = room(ROLLER)
    assert elsewhere(world, at(2.0, 1.0), None, 4.0).start == at(2.0, 1.0)
    with pytest.raises(UserError, match=r"taken.*at 4 s"):
        elsewhere(world, at(2.0, 3.0), None, 4.0)


def test_start_of_the_world_may_be_used_later() -> None:
    world = room(ROLLER, start=(2.0, 3.0, 0.0))
    assert elsewhere(world, None, None, 0.0) == world
    with pytest.raises(UserError, match="taken"):
        elsewhere(world, None, None, 4.0)


def test_goal_may_be_in_an_obstacle_but_not_outside() -> None:
    world = room(BOX)
    assert elsewhere(world, None, GoalPose(x_m=1.2, y_m=1.2), 0.0).goal.x_m == 1.2
    for goal in (GoalPose(x_m=99.0, y_m=1.0), GoalPose(x_m=nan, y_m=1.0)):
        with pytest.raises(UserError, match="goal"):
            elsewhere(world, None, goal, 0.0)
    with pytest.raises(UserError, match="finite"):
        elsewhere(world, None, GoalPose(x_m=1.0, y_m=1.0, heading_rad=inf), 0.0)


def plant_at(world: World, at_ns: int) -> Plant:
    return Plant(world, 1, LEVELS["none"], at_ns=at_ns)


def test_plant_started_later_matches_the_earlier_plant() -> None:
    """Compare sonars and contacts of a robot that does not move."""
    world = room(ROLLER, start=(1.4, 2.0, 0.0))
    begun, later = plant_at(world, 0), plant_at(world, 2_000_000_000)
    while begun.now_ns < later.now_ns:
        begun.advance()
    for _ in range(60):
        begun.advance()
        later.advance()
        assert begun.now_ns == later.now_ns
        assert begun.truth().clearance_m == pytest.approx(later.truth().clearance_m, abs=1e-9)
        assert begun.senses()[1] == later.senses()[1]


def test_score_of_a_later_start_counts_from_that_start() -> None:
    plant = plant_at(room(), 2_000_000_000)
    for _ in range(10):
        plant.advance()
    score = plant.score(plant.now_ns)
    assert (score.ticks, score.time_ns) == (10, 2_500_000_000)


RADIUS_M = 0.12


def world_with(*obstacles: Obstacle, walls: bool = True, radius_m: float = RADIUS_M) -> World:
    return plain_world(
        "test",
        (6.0, 4.0),
        (1.0, 2.0),
        (5.0, 2.0),
        *obstacles,
        walls=walls,
        robot={"radius_m": radius_m, "track_m": radius_m},
    )


def box(x0: float, y0: float, x1: float, y1: float) -> WorldPolygon:
    return WorldPolygon(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def length_m(*obstacles: Obstacle, walls: bool = True) -> float:
    found = shortest_path_m(world_with(*obstacles, walls=walls))
    assert found is not None
    return found


def around_disc_m(radius_m: float, half_m: float) -> float:
    """Return the length of tangent, arc and tangent past a disc halfway along `2 * half_m`."""
    tangent_m = sqrt(half_m**2 - radius_m**2)
    return 2.0 * tangent_m + radius_m * (pi - 2.0 * acos(radius_m / half_m))


def test_path_without_obstacles_is_a_straight_line() -> None:
    assert isclose(length_m(), 4.0)


@each("radius_m", [0.05, 0.4, 0.8, 1.5])
def test_path_around_a_disc_is_tangent_arc_tangent(radius_m: float) -> None:
    exact_m = around_disc_m(radius_m + RADIUS_M, 2.0)
    assert (
        exact_m - 1e-4
        <= length_m(WorldCircle(x_m=3.0, y_m=2.0, radius_m=radius_m))
        < 1.006 * exact_m
    )


def test_path_passes_a_box_on_its_short_side() -> None:
    # Tangent to the corner circle, straight along the top, and the same again.
    along_m, up_m = 1.5, 0.3
    to_corner_m = sqrt(along_m**2 + up_m**2 - RADIUS_M**2)
    turn_rad = pi / 2 - acos(RADIUS_M / hypot(along_m, up_m)) + _elevation(along_m, up_m)
    exact_m = 2.0 * (to_corner_m + RADIUS_M * turn_rad) + 1.0
    assert isclose(length_m(box(2.5, 1.0, 3.5, 2.3)), exact_m, rel_tol=0.006)


def _elevation(along_m: float, up_m: float) -> float:
    return acos(along_m / hypot(along_m, up_m))


def test_path_respects_the_thickness_of_a_wall() -> None:
    thick = Polyline(((3.0, 0.0), (3.0, 2.5)), 0.4)
    # Its round end is a disc of 0.2 m, which the robot passes above.
    exact_m = length_m(WorldCircle(x_m=3.0, y_m=2.5, radius_m=0.2), box(2.9, 0.0, 3.1, 2.5))
    assert isclose(length_m(thick), exact_m, rel_tol=1e-3)


def test_path_needs_the_width_of_the_robot() -> None:
    narrow = (box(2.9, 0.0, 3.1, 1.9), box(2.9, 2.13, 3.1, 4.0))
    wide = (box(2.9, 0.0, 3.1, 1.9), box(2.9, 2.17, 3.1, 4.0))
    assert shortest_path(world_with(*narrow)) is None
    assert length_m(*wide) < 4.1
    assert shortest_path(world_with(*narrow, radius_m=0.1)) is not None


def test_wall_across_the_room_leaves_no_path() -> None:
    across = Polyline(((3.0, 0.0), (3.0, 4.0)))
    assert shortest_path(world_with(across)) is None
    assert shortest_path_m(world_with(across)) is None


def test_path_goes_outside_when_there_are_no_outer_walls() -> None:
    assert 5.6 < length_m(Polyline(((3.0, 0.0), (3.0, 4.0))), walls=False) < 6.1


def test_point_that_is_given_twice_changes_nothing() -> None:
    once = length_m(Polyline(((2.0, 0.8), (2.0, 3.0))))
    assert length_m(Polyline(((2.0, 0.8), (2.0, 3.0), (2.0, 3.0)))) == once > 0.0


def test_enclosed_goal_has_no_path() -> None:
    ring = Polyline(((4.5, 1.5), (5.5, 1.5), (5.5, 2.5), (4.5, 2.5), (4.5, 1.5)))
    assert shortest_path(world_with(ring)) is None


def test_path_leaves_a_trap_around_its_arms() -> None:
    trap = Polyline(((0.5, 2.5), (2.5, 2.5), (2.5, 1.5), (0.5, 1.5)), 0.02)
    # Tangent to the arm's end, round it, along the arm, round its joint, tangent to the goal.
    exact_m = 0.695 + 0.130 * 2.541 + 2.0 + 0.130 * 0.248 + 2.546
    assert isclose(length_m(trap), exact_m, rel_tol=0.006)


def test_moving_obstacles_are_ignored() -> None:
    walker = WorldCircle(
        x_m=3.0, y_m=2.0, radius_m=0.5, path_m=((3.0, 2.0), (3.0, 3.0)), speed_m_s=0.1
    )
    assert isclose(length_m(walker), 4.0)


discs = st.lists(
    st.builds(
        WorldCircle, x_m=st.floats(1.8, 4.2), y_m=st.floats(0.2, 3.8), radius_m=st.floats(0.02, 0.6)
    ),
    max_size=8,
)


@settings(max_examples=60, deadline=None)
@given(discs)
def test_adding_a_disc_never_shortens_the_path(
    circles: list[WorldCircle],
) -> None:
    before_m = 4.0
    for count in range(1, len(circles) + 1):
        path = shortest_path(world_with(*circles[:count]))
        if path is None:
            return
        after_m = sum(dist(a, b) for a, b in pairwise(path))
        assert after_m >= 0.994 * before_m
        assert all(_clear(a, b, circles[:count]) for a, b in pairwise(path))
        before_m = after_m


def _clear(a: tuple[float, float], b: tuple[float, float], circles: list[WorldCircle]) -> bool:
    points = [(a[0] + (b[0] - a[0]) * i / 50, a[1] + (b[1] - a[1]) * i / 50) for i in range(51)]
    return all(clearance_m(p, one) >= RADIUS_M - 1e-5 for p in points for one in circles)


def test_each_shipped_world_takes_under_a_second() -> None:
    for name in shipped():
        world, before_s = load(name), thread_time()
        shortest_path(world)
        assert thread_time() - before_s < 1.0, name


def test_one_robot_starts_at_the_start_of_the_world() -> None:
    assert starts(room(start=(1.0, 2.0, 0.7)), Body(), 1) == [(1.0, 2.0, 0.7)]


def test_several_robots_start_side_by_side_with_a_gap() -> None:
    places = starts(room(start=(1.0, 2.0, pi / 2)), Body(), 3)
    assert [place[:2] for place in places] == [
        pytest.approx((1.0, 2.0)),
        pytest.approx((0.4, 2.0)),
        pytest.approx((1.6, 2.0)),
    ]
    assert {place[2] for place in places} == {pi / 2}
    assert min(dist(a[:2], b[:2]) for a, b in combinations(places, 2)) > 2.0 * 0.12


def test_world_may_ask_for_a_wider_gap_between_starts_and_goals() -> None:
    world = room(start=(1.0, 2.0, 0.0))
    world = replace(world, start=replace(world.start, gap_m=0.96))
    places = starts(world, Body(), 3)
    assert [place[1] for place in places] == pytest.approx([2.0, 3.2, 0.8])
    ends_at = goals(world, Body(), places, (3.0, 2.0))
    assert [one.y_m for one in ends_at] == pytest.approx([2.0, 3.2, 0.8])


def test_start_places_in_walls_and_obstacles_are_skipped() -> None:
    pillar = WorldCircle(x_m=1.0, y_m=1.0, radius_m=0.1)
    block = WorldPolygon(((0.8, 2.0), (1.2, 2.0), (1.2, 2.6), (0.8, 2.6)))
    places = starts(room(pillar, block, start=(1.0, 0.5, 0.0)), Body(), 3)
    assert [round(place[1], 3) for place in places] == [0.5, 1.7, 2.9]


def test_full_rank_is_followed_by_one_behind_and_one_ahead() -> None:
    places = starts(room(start=(1.0, 2.0, 0.0)), Body(), 21)
    assert [round(x_m, 3) for x_m, _, _ in places] == [1.0] * 7 + [0.4] * 7 + [1.6] * 7
    assert min(dist(a[:2], b[:2]) for a, b in combinations(places, 2)) > 0.59


def test_too_many_robots_are_rejected_with_the_number_that_fits() -> None:
    with pytest.raises(ValueError, match=r"^robots: room has room for 35 beside .* not for 99"):
        starts(room(), Body(), 99)


def test_zero_robots_are_rejected() -> None:
    with pytest.raises(ValueError, match=r"^robots: 0 is less than one"):
        starts(room(), Body(), 0)
