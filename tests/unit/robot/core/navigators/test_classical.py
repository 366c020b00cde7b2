from math import cos, inf, nan, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core import states
from robot.core.navigators import classical as boundaries
from robot.core.navigators import registry
from robot.core.navigators.classical import Boundary
from robot.core.parameters import DEFAULTS
from robot.core.perception.sonar_ring import Ring
from robot.core.values import BEARINGS, HALF_CONE, Goal, Pose
from tests.support.each import each
from tests.support.robot.core.rings import HERE, Wall, ring, seen_from

GOAL = Goal(3.0, 0.0, None, 0.05, 0.05)
BUGS = (states.BUG1, states.BUG2, states.DISTBUG)


def looking(echoes: dict[int, int], goal: Goal = GOAL, ticks: int = 3) -> Boundary:
    boundary = Boundary()
    for _ in range(ticks):
        boundaries.look(boundary, HERE, ring(echoes), goal, DEFAULTS)
    return boundary


def met(boundary: Boundary) -> bool:
    """Return whether an unchanged obstacle counts as met."""
    return [boundaries.meets(boundary, DEFAULTS) for _ in range(boundaries.HIT_TICKS)][-1]


def test_near_obstacle_in_the_way_is_met() -> None:
    assert met(looking({3: 180, 4: 180}))
    assert not met(looking({3: 500, 4: 500}))
    assert not met(looking({0: 60, 7: 60}))


def test_obstacle_beyond_the_goal_is_not_in_the_way() -> None:
    near = Goal(0.2, 0.0, None, 0.05, 0.05)
    assert not met(looking({3: 230, 4: 230}, near))
    assert met(looking({3: 100, 4: 100}, near))


def test_walls_along_the_way_leave_it_free() -> None:
    walls: list[Wall] = [(-9.0, -0.2, 9.0, -0.2), (-9.0, 0.2, 9.0, 0.2)]
    boundary = Boundary()
    for _ in range(3):
        boundaries.look(boundary, HERE, seen_from(HERE, walls), GOAL, DEFAULTS)
    assert not met(boundary)


def test_near_goal_with_a_free_way_is_at_hand() -> None:
    near = Goal(0.5, 0.0, None, 0.05, 0.05)
    assert boundaries.goal_at_hand(looking({}, near), DEFAULTS)
    assert not boundaries.goal_at_hand(looking({}), DEFAULTS)
    assert not boundaries.goal_at_hand(looking({3: 300}, near), DEFAULTS)
    behind = Goal(-0.5, 0.0, None, 0.05, 0.05)
    assert not boundaries.goal_at_hand(looking({}, behind), DEFAULTS)


def test_a_new_goal_starts_afresh() -> None:
    boundary = looking({3: 180, 4: 180})
    boundaries.follow(boundary, HERE, states.LEFT, DEFAULTS)
    assert not boundaries.look(boundary, HERE, ring({}), GOAL, DEFAULTS)
    assert boundary.following
    assert boundaries.look(boundary, HERE, ring({}), Goal(9.0, 0, None, 0.05, 0.05), DEFAULTS)
    assert not boundary.following
    assert boundary.best_m == 9.0


def test_leaving_at_the_nearest_point_without_gain_is_the_end() -> None:
    boundary = looking({})
    boundary.near_m = 2.0
    assert not boundaries.is_unreachable(boundary)
    boundary.left_at_nearest = True
    assert boundaries.is_unreachable(boundary)
    boundary.near_m = 3.5
    assert not boundaries.is_unreachable(boundary)


def test_boundary_is_not_left_at_the_meeting_point() -> None:
    boundary = looking({3: 180, 4: 180})
    boundaries.follow(boundary, HERE, states.LEFT, DEFAULTS)
    boundaries.circle(boundary, HERE, True)
    assert not boundaries.under_way(boundary)
    for k in range(10):
        boundaries.rounded(boundary, Pose(0.0, 0.012 * k, 0.0))
    assert boundaries.under_way(boundary)


def test_boundary_met_no_nearer_continues_its_lap() -> None:
    boundary = looking({3: 180, 4: 180})
    for near_m, begun_m, laps in ((3.0, 3.0, 0), (2.95, 3.0, 1), (2.8, 2.8, 0)):
        boundaries.leave(boundary)
        boundary.laps = 1
        for _ in range(boundaries.HIT_TICKS):
            assert not boundary.following
            assert boundaries.advance(boundary, HERE, states.LEFT, near_m, 0.1, DEFAULTS)
        assert boundary.following
        assert (boundary.begun_m, boundary.laps) == (begun_m, laps)


def test_after_nearest_point_or_all_laps_it_gives_up() -> None:
    boundary = looking({3: 180, 4: 180})
    boundary.left_at_nearest, boundary.near_m = True, 2.0
    steps = [
        boundaries.advance(boundary, HERE, states.LEFT, 3.0, 0.1, DEFAULTS)
        for _ in range(boundaries.HIT_TICKS)
    ]
    assert steps == [True] * (boundaries.HIT_TICKS - 1) + [False]
    boundary.following, boundary.laps = True, boundaries.LAPS
    assert not boundaries.advance(boundary, HERE, states.LEFT, 3.0, 0.1, DEFAULTS)


ranges = st.lists(st.one_of(st.none(), st.just(inf), st.floats(0.03, 3.0)), min_size=8, max_size=8)


@given(ranges)
def test_speed_permits_stopping_before_any_echo(
    range_m: list[float | None],
) -> None:
    seen = Ring()
    seen.range_m = range_m
    limit_m_s = boundaries.speed_limit_m_s(seen, DEFAULTS)
    assert 0.0 <= limit_m_s <= DEFAULTS.v_max_m_s
    for i, here_m in enumerate(range_m):
        if here_m is None:
            continue
        closing = cos(max(abs(BEARINGS[i]) - HALF_CONE, 0.0))
        room_m = max(here_m - boundaries.STOP_M, 0.0)
        slow = limit_m_s <= boundaries.CREEP_M_S and i in (0, 1, 6, 7)
        assert slow or limit_m_s * closing * boundaries.TIME_S <= room_m + 1e-9


def test_it_creeps_without_range_ahead_and_stops_close_ahead() -> None:
    seen = ring({})
    assert boundaries.speed_limit_m_s(seen, DEFAULTS) == DEFAULTS.v_max_m_s
    seen.range_m[3] = None
    assert boundaries.speed_limit_m_s(seen, DEFAULTS) == boundaries.CREEP_M_S
    assert boundaries.speed_limit_m_s(ring({3: 35}), DEFAULTS) == 0.0
    assert boundaries.speed_limit_m_s(ring({0: 35}), DEFAULTS) == boundaries.CREEP_M_S


numbers = st.one_of(st.sampled_from([nan, inf, -inf, 0.0, 1e300]), st.floats(-5.0, 5.0))
anything = st.lists(
    st.one_of(st.none(), st.sampled_from([nan, inf, 0.03]), st.floats(0.0, 4.0)),
    min_size=8,
    max_size=8,
)
story = st.lists(st.tuples(anything, numbers, numbers, numbers), min_size=1, max_size=12)


@pytest.mark.parametrize("number", BUGS)
@given(story, numbers, numbers)
def test_a_step_is_total_and_never_drives_into_the_unknown(
    number: int,
    moments: list[tuple[list[float | None], float, float, float]],
    goal_x_m: float,
    goal_y_m: float,
) -> None:
    memory, step = registry.new_memory(number, states.LEFT), registry.NAVIGATORS[number].step
    goal, seen = Goal(goal_x_m, goal_y_m, None, 0.05, 0.05), Ring()
    for range_m, x_m, y_m, heading_rad in moments:
        seen.range_m = range_m
        decision = step(memory, Pose(x_m, y_m, heading_rad), seen, goal, DEFAULTS)
        assert 0.0 <= decision.speed_limit_m_s <= DEFAULTS.v_max_m_s
        assert -pi <= decision.goal_bearing_rad <= pi
        assert -pi <= decision.rotation_rad <= pi
        if not all(map(finite, (x_m, y_m, heading_rad, goal_x_m, goal_y_m))):
            assert decision.speed_limit_m_s == 0.0


def finite(number: float) -> bool:
    return number - number == 0.0


@each("number", BUGS)
def test_missing_ranges_while_following_limit_to_creeping(number: int) -> None:
    memory, step = registry.new_memory(number, states.LEFT), registry.NAVIGATORS[number].step
    for _ in range(5):
        step(memory, HERE, ring({3: 180, 4: 180}), GOAL, DEFAULTS)
    blind = Ring()
    decisions = [step(memory, HERE, blind, GOAL, DEFAULTS) for _ in range(20)]
    assert all(d.speed_limit_m_s <= boundaries.CREEP_M_S for d in decisions)


@each("flank", [0, 1, 6, 7])
def test_wall_beside_does_not_raise_the_speed_limit(flank: int) -> None:
    ahead = {3: 24, 4: 24}
    limit_m_s = boundaries.speed_limit_m_s(ring(ahead), DEFAULTS)
    assert limit_m_s < boundaries.CREEP_M_S
    assert boundaries.speed_limit_m_s(ring({**ahead, flank: 20}), DEFAULTS) == limit_m_s
