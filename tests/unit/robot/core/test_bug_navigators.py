"""The bug navigators: each algorithm of the literature, and the boundary they follow."""

from itertools import pairwise
from math import atan2, cos, degrees, hypot, inf, nan, pi, radians, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core import states
from robot.core.navigators import boundary_follower as followers
from robot.core.navigators import classical, registry, vgm_and_bug
from robot.core.navigators import classical as boundaries
from robot.core.navigators.boundary_follower import Follower
from robot.core.navigators.classical import Boundary
from robot.core.navigators.vgm_and_bug import PaperMemory
from robot.core.parameters import DEFAULTS
from robot.core.perception.sonar_ring import Ring
from robot.core.ring import BEARINGS, HALF_CONE
from robot.core.values import Decision, Goal, Pose, wrap
from tests.support.cores import (
    BEHIND_THE_TRAP,
    BOX_AROUND_THE_GOAL,
    DISC,
    FAR,
    U_TRAP,
    Disc,
    Wall,
    clearance_m,
    ring,
    rolled,
    seen_from,
    walk_to,
)
from tests.support.cores import GOAL as COURSES_GOAL
from tests.support.cores import HERE as RINGS_HERE
from tests.support.each import each

AHEAD = Goal(5.0, 0.0, None, 0.05, 0.05)
HERE = Pose(0.0, 0.0, 0.0)
RIGHT_WALL = {0: 150, 1: 172, 2: 262}  # parallel, at the distance to follow


def memory(side: int = states.LEFT) -> PaperMemory:
    fresh = registry.new_memory(states.BUG, side)
    assert isinstance(fresh, PaperMemory)
    return fresh


def steered_deg(decision: Decision, pose: Pose = HERE) -> float:
    """Return the bearing of the virtual goal."""
    dx_m, dy_m = decision.virtual_x_m - pose.x_m, decision.virtual_y_m - pose.y_m
    return degrees(wrap(atan2(dy_m, dx_m) - pose.heading_rad))


def step(remembered: PaperMemory, echoes: dict[int, int], goal: Goal = AHEAD) -> Decision:
    return vgm_and_bug.step_bug(remembered, HERE, ring(echoes), goal, DEFAULTS)


def following(side: int = states.LEFT) -> PaperMemory:
    """Meet an obstacle ahead and turn until it is beside the robot."""
    remembered = memory(side)
    step(remembered, {3: 250, 4: 250})
    step(remembered, RIGHT_WALL if side == states.LEFT else mirrored(RIGHT_WALL), behind(side))
    assert remembered.following
    assert remembered.beside
    return remembered


def mirrored(echoes: dict[int, int]) -> dict[int, int]:
    return {7 - i: mm for i, mm in echoes.items()}


def behind(side: int) -> Goal:
    """Return a goal behind the wall, out of view, which is no reason to leave."""
    return Goal(-1.0, -3.0 * side, None, 0.05, 0.05)


def test_with_a_free_way_it_heads_for_the_goal() -> None:
    decision = step(memory(), {3: 301, 4: 301, 0: 100})
    assert decision.branch == states.TO_GOAL
    assert (decision.virtual_x_m, decision.virtual_y_m) == (5.0, 0.0)


@each("side", [states.LEFT, states.RIGHT])
@each("sonar", [3, 4])
def test_an_obstacle_ahead_is_passed_on_the_side_the_user_chose(side: int, sonar: int) -> None:
    decision = step(memory(side), {sonar: 250})
    assert decision.branch == (states.PASS_LEFT if side == states.LEFT else states.PASS_RIGHT)
    assert steered_deg(decision) * side > 45.0


def test_an_obstacle_beyond_the_goal_is_not_in_the_way() -> None:
    assert step(memory(), {3: 250}, Goal(0.2, 0.0, None, 0.05, 0.05)).branch == states.TO_GOAL


def test_it_leaves_when_the_way_to_the_goal_is_open() -> None:
    remembered = following()
    assert step(remembered, RIGHT_WALL).branch == states.TO_GOAL
    assert not remembered.following


def test_a_wall_beside_is_followed_straight_on() -> None:
    for side, wall in ((states.LEFT, RIGHT_WALL), (states.RIGHT, mirrored(RIGHT_WALL))):
        decision = step(following(side), wall, behind(side))
        assert steered_deg(decision) == pytest.approx(0.0, abs=2.0)


def test_too_near_it_steers_away_and_too_far_back() -> None:
    near, far = {0: 90, 1: 107, 2: 180}, {0: 230, 1: 259, 2: 370}
    assert steered_deg(step(following(), near, behind(states.LEFT))) > 8.0
    assert steered_deg(step(following(), far, behind(states.LEFT))) < -8.0


def test_leaning_towards_the_wall_it_straightens_up() -> None:
    towards, away = {0: 150, 1: 155}, {0: 150, 1: 205}
    assert steered_deg(step(following(), towards, behind(states.LEFT))) > 5.0
    assert steered_deg(step(following(), away, behind(states.LEFT))) < -5.0


def test_an_inner_corner_turns_it_away() -> None:
    corner = {**RIGHT_WALL, 3: 140, 4: 145}
    assert steered_deg(step(following(), corner, behind(states.LEFT))) > 45.0


def test_opposite_wall_is_not_the_followed_one() -> None:
    gap = {3: 400, 4: 380, 5: 330}
    decision = step(following(), gap, behind(states.LEFT))
    assert steered_deg(decision) < -10.0  # around the end of the followed wall, into the gap


def test_lost_wall_is_searched_for_three_quarters_of_a_turn() -> None:
    remembered, heading_rad, turned_rad = following(), 0.0, 0.0
    while remembered.following:
        heading_rad = wrap(heading_rad - 0.1)
        turned_rad += 0.1
        pose = Pose(0.0, 0.0, heading_rad)
        far_behind = Goal(-5.0 * cos(heading_rad), -5.0 * sin(heading_rad), None, 0.05, 0.05)
        vgm_and_bug.step_bug(remembered, pose, ring({}), far_behind, DEFAULTS)
        assert turned_rad < 10.0
    assert turned_rad == pytest.approx(1.5 * pi, abs=0.2)


ranges = st.lists(st.one_of(st.none(), st.integers(20, 3000)), min_size=8, max_size=8)


@given(st.lists(ranges, min_size=1, max_size=10), st.floats(-pi, pi), st.sampled_from([1, -1]))
def test_left_and_right_are_mirror_images(
    scans: list[list[int | None]], goal_at_rad: float, side: int
) -> None:
    one, other = memory(side), memory(-side)
    x_m, y_m = 4.0 * cos(goal_at_rad), 4.0 * sin(goal_at_rad)
    for scan in scans:
        echoes = {i: mm for i, mm in enumerate(scan) if mm is not None}
        a = step(one, echoes, Goal(x_m, y_m, None, 0.05, 0.05))
        b = step(other, mirrored(echoes), Goal(x_m, -y_m, None, 0.05, 0.05))
        assert one.following == other.following
        assert a.virtual_x_m == pytest.approx(b.virtual_x_m, abs=1e-6)
        assert a.virtual_y_m == pytest.approx(-b.virtual_y_m, abs=1e-6)


GOAL = Goal(3.0, 0.0, None, 0.05, 0.05)
BUGS = (states.BUG1, states.BUG2, states.DISTBUG)


def classical_looking(echoes: dict[int, int], goal: Goal = GOAL, ticks: int = 3) -> Boundary:
    boundary = Boundary()
    for _ in range(ticks):
        boundaries.look(boundary, RINGS_HERE, ring(echoes), goal, DEFAULTS)
    return boundary


def met(boundary: Boundary) -> bool:
    """Return whether an unchanged obstacle counts as met."""
    return [boundaries.meets(boundary, DEFAULTS) for _ in range(boundaries.HIT_TICKS)][-1]


def test_near_obstacle_in_the_way_is_met() -> None:
    assert met(classical_looking({3: 180, 4: 180}))
    assert not met(classical_looking({3: 500, 4: 500}))
    assert not met(classical_looking({0: 60, 7: 60}))


def test_obstacle_beyond_the_goal_is_not_in_the_way() -> None:
    near = Goal(0.2, 0.0, None, 0.05, 0.05)
    assert not met(classical_looking({3: 230, 4: 230}, near))
    assert met(classical_looking({3: 100, 4: 100}, near))


def test_walls_along_the_way_leave_it_free() -> None:
    walls: list[Wall] = [(-9.0, -0.2, 9.0, -0.2), (-9.0, 0.2, 9.0, 0.2)]
    boundary = Boundary()
    for _ in range(3):
        boundaries.look(boundary, RINGS_HERE, seen_from(RINGS_HERE, walls), GOAL, DEFAULTS)
    assert not met(boundary)


def test_near_goal_with_a_free_way_is_at_hand() -> None:
    near = Goal(0.5, 0.0, None, 0.05, 0.05)
    assert boundaries.goal_at_hand(classical_looking({}, near), DEFAULTS)
    assert not boundaries.goal_at_hand(classical_looking({}), DEFAULTS)
    assert not boundaries.goal_at_hand(classical_looking({3: 300}, near), DEFAULTS)
    behind = Goal(-0.5, 0.0, None, 0.05, 0.05)
    assert not boundaries.goal_at_hand(classical_looking({}, behind), DEFAULTS)


def test_a_new_goal_starts_afresh() -> None:
    boundary = classical_looking({3: 180, 4: 180})
    boundaries.follow(boundary, RINGS_HERE, states.LEFT, DEFAULTS)
    assert not boundaries.look(boundary, RINGS_HERE, ring({}), GOAL, DEFAULTS)
    assert boundary.following
    assert boundaries.look(boundary, RINGS_HERE, ring({}), Goal(9.0, 0, None, 0.05, 0.05), DEFAULTS)
    assert not boundary.following
    assert boundary.best_m == 9.0


def test_leaving_at_the_nearest_point_without_gain_is_the_end() -> None:
    boundary = classical_looking({})
    boundary.near_m = 2.0
    assert not boundaries.is_unreachable(boundary)
    boundary.left_at_nearest = True
    assert boundaries.is_unreachable(boundary)
    boundary.near_m = 3.5
    assert not boundaries.is_unreachable(boundary)


def test_boundary_is_not_left_at_the_meeting_point() -> None:
    boundary = classical_looking({3: 180, 4: 180})
    boundaries.follow(boundary, RINGS_HERE, states.LEFT, DEFAULTS)
    boundaries.circle(boundary, RINGS_HERE, True)
    assert not boundaries.under_way(boundary)
    for k in range(10):
        boundaries.rounded(boundary, Pose(0.0, 0.012 * k, 0.0))
    assert boundaries.under_way(boundary)


def test_boundary_met_no_nearer_continues_its_lap() -> None:
    boundary = classical_looking({3: 180, 4: 180})
    for near_m, begun_m, laps in ((3.0, 3.0, 0), (2.95, 3.0, 1), (2.8, 2.8, 0)):
        boundaries.leave(boundary)
        boundary.laps = 1
        for _ in range(boundaries.HIT_TICKS):
            assert not boundary.following
            assert boundaries.advance(boundary, RINGS_HERE, states.LEFT, near_m, 0.1, DEFAULTS)
        assert boundary.following
        assert (boundary.begun_m, boundary.laps) == (begun_m, laps)


def test_after_nearest_point_or_all_laps_it_gives_up() -> None:
    boundary = classical_looking({3: 180, 4: 180})
    boundary.left_at_nearest, boundary.near_m = True, 2.0
    steps = [
        boundaries.advance(boundary, RINGS_HERE, states.LEFT, 3.0, 0.1, DEFAULTS)
        for _ in range(boundaries.HIT_TICKS)
    ]
    assert steps == [True] * (boundaries.HIT_TICKS - 1) + [False]
    boundary.following, boundary.laps = True, boundaries.LAPS
    assert not boundaries.advance(boundary, RINGS_HERE, states.LEFT, 3.0, 0.1, DEFAULTS)


classical_ranges = st.lists(
    st.one_of(st.none(), st.just(inf), st.floats(0.03, 3.0)), min_size=8, max_size=8
)


@given(classical_ranges)
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
        step(memory, RINGS_HERE, ring({3: 180, 4: 180}), GOAL, DEFAULTS)
    blind = Ring()
    decisions = [step(memory, RINGS_HERE, blind, GOAL, DEFAULTS) for _ in range(20)]
    assert all(d.speed_limit_m_s <= boundaries.CREEP_M_S for d in decisions)


@each("flank", [0, 1, 6, 7])
def test_wall_beside_does_not_raise_the_speed_limit(flank: int) -> None:
    ahead = {3: 24, 4: 24}
    limit_m_s = boundaries.speed_limit_m_s(ring(ahead), DEFAULTS)
    assert limit_m_s < boundaries.CREEP_M_S
    assert boundaries.speed_limit_m_s(ring({**ahead, flank: 20}), DEFAULTS) == limit_m_s


BELOW: list[Wall] = [(-9.0, -0.25, 9.0, -0.25)]
SPEED_M_S = 0.2


def started(pose: Pose, seen: Ring, toward_deg: float, side: int = 1) -> Follower:
    follower = Follower()
    followers.sense(follower, pose, seen, DEFAULTS)
    followers.start(follower, pose, side, radians(toward_deg), DEFAULTS)
    return follower


def turn_deg(follower: Follower, pose: Pose, seen: Ring, ticks: int = 12) -> float:
    """Return the steered direction after a while at the same place."""
    wanted_rad = 0.0
    for _ in range(ticks):
        followers.sense(follower, pose, seen, DEFAULTS)
        wanted_rad = followers.heading(follower, pose, DEFAULTS)
    return degrees(wanted_rad)


def walk(
    pose: Pose, walls: list[Wall], discs: list[Disc], seconds: float, side: int = 1
) -> tuple[list[Pose], Follower]:
    """Follow the obstacle ahead; the robot turns towards its heading and slows down as needed."""
    follower = started(pose, seen_from(pose, walls, discs), 0.0, side)
    poses = [pose]
    for _ in range(round(seconds * 20)):
        followers.sense(follower, pose, seen_from(pose, walls, discs), DEFAULTS)
        wanted_rad = followers.heading(follower, pose, DEFAULTS)
        pose = rolled(pose, wanted_rad, SPEED_M_S)
        poses.append(pose)
    return poses, follower


def test_follower_goes_straight_on_along_a_wall() -> None:
    seen = seen_from(RINGS_HERE, BELOW)
    assert turn_deg(started(RINGS_HERE, seen, -80.0), RINGS_HERE, seen) == pytest.approx(
        0.0, abs=4.0
    )


def test_follower_steers_away_if_near_and_back_if_far() -> None:
    near, far = (
        seen_from(RINGS_HERE, [(-9.0, -0.18, 9.0, -0.18)]),
        seen_from(RINGS_HERE, [(-9, -0.32, 9, -0.32)]),
    )
    assert turn_deg(started(RINGS_HERE, near, -80.0), RINGS_HERE, near) > 10.0
    assert turn_deg(started(RINGS_HERE, far, -80.0), RINGS_HERE, far) < -10.0


def test_an_inner_corner_turns_it_away_from_the_wall() -> None:
    seen = seen_from(RINGS_HERE, [*BELOW, (0.30, -0.25, 0.30, 3.0)])
    assert turn_deg(started(RINGS_HERE, seen, -80.0), RINGS_HERE, seen) > 45.0


def test_a_wall_that_ends_is_remembered_where_the_ring_is_blind() -> None:
    follower = started(RINGS_HERE, seen_from(RINGS_HERE, BELOW), -80.0)
    for k in range(10):
        pose = Pose(0.02 * k, 0.0, 0.0)
        followers.sense(follower, pose, seen_from(pose, BELOW), DEFAULTS)
        followers.heading(follower, pose, DEFAULTS)
    beyond = Pose(0.35, 0.0, 0.0)
    assert turn_deg(follower, beyond, ring({})) < -10.0
    assert not follower.lost


def test_points_without_new_echoes_are_dropped_in_the_end() -> None:
    follower = started(RINGS_HERE, seen_from(RINGS_HERE, BELOW), -80.0)
    turn_deg(follower, RINGS_HERE, seen_from(RINGS_HERE, BELOW))
    turn_deg(follower, RINGS_HERE, ring({}), followers.OLD_TICKS + 2)
    assert follower.lost


def test_contradicted_points_are_dropped_at_once() -> None:
    ahead = ring({3: 150, 4: 150})
    follower = started(RINGS_HERE, ahead, 0.0)
    turn_deg(follower, RINGS_HERE, ahead)
    turn_deg(follower, RINGS_HERE, ring({3: 2000, 4: 2000}), 8)
    assert follower.lost


def test_walls_all_round_leave_no_way_but_to_turn() -> None:
    box: list[Wall] = [(-0.13, -0.13, 0.13, -0.13), (0.13, -0.13, 0.13, 0.13)]
    box += [(0.13, 0.13, -0.13, 0.13), (-0.13, 0.13, -0.13, -0.13)]
    follower = started(RINGS_HERE, seen_from(RINGS_HERE, box), 0.0)
    for k in range(80):
        pose = Pose(0.0, 0.0, wrap(0.1 * k))
        followers.sense(follower, pose, seen_from(pose, box), DEFAULTS)
        turned_rad = followers.heading(follower, pose, DEFAULTS)
        assert follower.boxed or abs(turned_rad) > 0.5


def test_single_false_echo_or_dropout_is_ignored() -> None:
    follower = Follower()
    for range_mm in (1500, 1505, 300, 1498, None, 1502):
        followers.sense(
            follower, RINGS_HERE, ring({} if range_mm is None else {4: range_mm}), DEFAULTS
        )
        seen_m = follower.seen_m[4]
        assert seen_m == pytest.approx(1.5, abs=0.01)
    for _ in range(2):
        followers.sense(follower, RINGS_HERE, ring({4: 300}), DEFAULTS)
    assert follower.seen_m[4] == 0.3


@each("side", [1, -1])
def test_a_disc_is_circled_at_a_steady_distance(side: int) -> None:
    discs = [(0.7, 0.0, 0.3)]
    poses, follower = walk(RINGS_HERE, [], discs, 30.0, side)
    clearances = [clearance_m(pose, [], discs) for pose in poses[80:]]
    assert min(clearances) > 0.08
    assert max(clearances) < 0.18
    angles = [wrap(b.heading_rad - a.heading_rad) for a, b in pairwise(poses)]
    assert -side * sum(angles[80:]) > 2.0 * pi
    assert not follower.lost


def test_thin_wall_is_followed_around_its_end() -> None:
    wall: list[Wall] = [(0.4, -3.0, 0.4, 0.5)]
    poses, _ = walk(RINGS_HERE, wall, [], 25.0)
    assert min(clearance_m(pose, wall) for pose in poses) > 0.07
    assert poses[-1].x_m > 0.5
    assert poses[-1].y_m < -0.5


def test_a_dead_end_is_entered_and_left_again() -> None:
    walls: list[Wall] = [(0.0, -0.3, 2.0, -0.3), (2.0, -0.3, 2.0, 0.3), (2.0, 0.3, 0.0, 0.3)]
    poses, _ = walk(Pose(0.9, 0.0, -0.6), walls, [], 25.0)
    assert min(clearance_m(pose, walls) for pose in poses) > 0.05
    inmost = max(range(len(poses)), key=lambda k: poses[k].x_m)
    assert poses[inmost].x_m > 1.6
    assert min(pose.x_m for pose in poses[inmost:]) < 0.1


def test_a_door_half_a_metre_wide_is_gone_through() -> None:
    walls: list[Wall] = [(-3.0, -0.25, 1.0, -0.25), (1.5, -0.25, 4.0, -0.25)]
    poses, _ = walk(Pose(0.0, 0.0, -0.3), walls, [], 20.0)
    assert min(clearance_m(pose, walls) for pose in poses) > 0.04
    assert any(pose.y_m < -0.5 for pose in poses)


scans = st.lists(ranges, min_size=1, max_size=12)


@given(scans, st.floats(-0.1, 0.1), st.floats(-0.3, 0.3))
def test_follower_is_mirrored_on_the_other_side(
    seen: list[list[int | None]], step_m: float, turn_rad: float
) -> None:
    one, other = Follower(), Follower()
    other.side = -1
    for k, scan in enumerate(seen):
        pose, twin = Pose(k * step_m, 0.0, k * turn_rad), Pose(k * step_m, 0.0, -k * turn_rad)
        echoes = {i: mm for i, mm in enumerate(scan) if mm is not None}
        followers.sense(one, pose, ring(echoes), DEFAULTS)
        followers.sense(other, twin, ring({7 - i: mm for i, mm in echoes.items()}), DEFAULTS)
        if k == 0:
            followers.start(one, pose, 1, 0.0, DEFAULTS)
            followers.start(other, twin, -1, 0.0, DEFAULTS)
        left_rad = followers.heading(one, pose, DEFAULTS)
        right_rad = followers.heading(other, twin, DEFAULTS)
        assert abs(wrap(left_rad + right_rad)) < 1e-6 or any(map(equally_near, seen))


def equally_near(scan: list[int | None]) -> bool:
    """Return whether two echoes have the same range, or there is none: the order decides then."""
    near = [mm for mm in scan if mm is not None]
    return len(set(near)) < len(near)


any_ranges = st.lists(
    st.sampled_from([None, inf, 0.03, 0.1, 0.25, 0.4, 1.0]), min_size=8, max_size=8
)


@given(st.lists(st.tuples(any_ranges, st.floats(-2, 2), st.floats(-4, 4)), max_size=30))
def test_any_scans_anywhere_give_a_bearing_and_no_growing_memory(
    story: list[tuple[list[float | None], float, float]],
) -> None:
    follower, seen = Follower(), Ring()
    followers.start(follower, RINGS_HERE, 1, 0.0, DEFAULTS)
    for range_m, x_m, heading_rad in story:
        seen.range_m = range_m
        pose = Pose(x_m, 0.0, heading_rad)
        followers.sense(follower, pose, seen, DEFAULTS)
        assert -pi <= followers.heading(follower, pose, DEFAULTS) <= pi
    assert len(follower.points_x_m) == len(follower.points_tick) == followers.POINTS
    assert len(follower.bearing_rad) == followers.POINTS + 9


def test_with_a_free_way_it_drives_straight_to_the_goal() -> None:
    walk = walk_to(states.BUG1, COURSES_GOAL, [], [])
    assert walk.arrived
    assert walk.branches == {states.TO_GOAL}


@each("side", [states.LEFT, states.RIGHT])
def test_full_lap_precedes_leaving_at_the_nearest_point(side: int) -> None:
    walk = walk_to(states.BUG1, FAR, [], DISC, side=side)
    assert walk.arrived
    assert min(clearance_m(pose, [], DISC) for pose in walk.poses) > 0.05
    followed = [d.branch != states.TO_GOAL for d in walk.decisions]
    round_m = sum(
        hypot(b.x_m - a.x_m, b.y_m - a.y_m)
        for a, b, on in zip(walk.poses, walk.poses[1:], followed[1:], strict=False)
        if on
    )
    assert round_m > 3.0  # around the disc at the robot's distance, and back to the point
    last = max(k for k, on in enumerate(followed) if on)
    assert walk.poses[last].x_m > 1.6


def test_it_comes_back_the_shorter_way() -> None:
    walk = walk_to(states.BUG1, FAR, [], DISC)
    sides = [d.branch for d in walk.decisions if d.branch != states.TO_GOAL]
    assert sides[0] == states.PASS_LEFT
    assert len(walk.decisions) < 800


def test_a_goal_that_is_walled_in_is_unreachable() -> None:
    walk = walk_to(states.BUG1, COURSES_GOAL, BOX_AROUND_THE_GOAL, [])
    assert walk.gave_up
    assert min(clearance_m(pose, BOX_AROUND_THE_GOAL) for pose in walk.poses) > 0.05


def test_a_new_goal_forgets_the_old_one() -> None:
    memory = classical.Bug1Memory()
    here, ahead = Pose(0.0, 0.0, 0.0), ring({3: 150, 4: 150})
    for _ in range(5):
        classical.step_bug1(memory, here, ahead, COURSES_GOAL, DEFAULTS)
    assert memory.phase == classical.CIRCLING
    other = Goal(-2.0, 0.0, None, 0.05, 0.05)
    decision = classical.step_bug1(memory, here, seen_from(here, []), other, DEFAULTS)
    assert memory.phase == classical.GOING
    assert decision.branch == states.TO_GOAL


def test_an_obstacle_ahead_is_met_only_when_it_is_seen_twice() -> None:
    memory, here = classical.Bug2Memory(), Pose(0.0, 0.0, 0.0)
    ahead = ring({3: 180, 4: 180})
    assert classical.step_bug2(memory, here, ahead, COURSES_GOAL, DEFAULTS).branch == states.TO_GOAL
    assert (
        classical.step_bug2(memory, here, ahead, COURSES_GOAL, DEFAULTS).branch == states.PASS_LEFT
    )


@each("side", [states.LEFT, states.RIGHT])
def test_the_boundary_is_left_on_the_line_behind_the_obstacle(side: int) -> None:
    walk = walk_to(states.BUG2, FAR, [], DISC, side=side)
    assert walk.arrived
    left = max(k for k, d in enumerate(walk.decisions) if d.branch != states.TO_GOAL)
    assert abs(walk.poses[left].y_m) < 0.06
    assert walk.poses[left].x_m > 1.5
    assert min(clearance_m(pose, [], DISC) for pose in walk.poses) > 0.05


@each("side", [states.LEFT, states.RIGHT])
def test_a_trap_is_entered_and_left(side: int) -> None:
    walk = walk_to(states.BUG2, BEHIND_THE_TRAP, U_TRAP, [], side=side)
    assert walk.arrived
    assert max(pose.x_m for pose in walk.poses if abs(pose.y_m) < 0.4) > 1.6
    assert min(clearance_m(pose, U_TRAP) for pose in walk.poses) > 0.05


def test_line_crossed_farther_than_the_hit_is_not_left() -> None:
    boundary = classical.Bug2Memory().boundary
    boundary.begun_m = 2.0
    boundary.distance_m = 2.5
    assert not classical.leaves_bug2(boundary, True, DEFAULTS)
    boundary.distance_m = 1.5
    assert classical.leaves_bug2(boundary, True, DEFAULTS)
    assert not classical.leaves_bug2(boundary, False, DEFAULTS)


def test_line_crossed_between_two_ticks_is_detected() -> None:
    memory = classical.Bug2Memory()
    assert not classical.crosses(memory, Pose(1.0, 0.2, 0.0), COURSES_GOAL)
    assert classical.crosses(memory, Pose(1.0, -0.2, 0.0), COURSES_GOAL)
    assert not classical.crosses(memory, Pose(1.1, -0.2, 0.0), COURSES_GOAL)


def test_bug2_finds_a_walled_in_goal_unreachable() -> None:
    assert walk_to(states.BUG2, COURSES_GOAL, BOX_AROUND_THE_GOAL, []).gave_up


def test_walled_in_robot_gives_up() -> None:
    room: list[Wall] = [(-0.7, -0.7, 0.7, -0.7), (0.7, -0.7, 0.7, 0.7)]
    room += [(0.7, 0.7, -0.7, 0.7), (-0.7, 0.7, -0.7, -0.7)]
    assert walk_to(states.BUG2, COURSES_GOAL, room, []).gave_up


def test_disc_before_a_reachable_goal_is_passed() -> None:
    posts: list[Disc] = [(0.8, 0.0, 0.06), (1.3, 0.1, 0.06), (1.8, -0.1, 0.06)]
    walk = walk_to(states.BUG2, COURSES_GOAL, [], posts)
    assert walk.arrived
    assert min(clearance_m(pose, [], posts) for pose in walk.poses) > 0.02


def looking(
    echoes: dict[int, int], best_m: float, goal: Goal = COURSES_GOAL
) -> classical.DistBugMemory:
    memory = classical.DistBugMemory()
    for _ in range(3):
        boundaries.look(memory.boundary, RINGS_HERE, ring(echoes), goal, DEFAULTS)
    memory.boundary.best_m = best_m
    return memory


def test_it_leaves_when_the_free_way_leads_nearer_than_ever() -> None:
    clear = looking({3: 1500, 4: 1500}, 2.0)
    assert classical.leads_nearer(clear.boundary, DEFAULTS)
    shut = looking({3: 600, 4: 600}, 2.0)
    assert not classical.leads_nearer(shut.boundary, DEFAULTS)


def test_a_way_out_of_view_is_not_known_to_be_free() -> None:
    behind = looking({}, 3.0, Goal(-2.4, 0.0, None, 0.05, 0.05))
    assert not classical.leads_nearer(behind.boundary, DEFAULTS)


def test_an_open_moment_is_not_enough() -> None:
    memory = looking({3: 1500, 4: 1500}, 2.0)
    memory.boundary.laps = 0
    answers = [classical.leaves_distbug(memory, DEFAULTS) for _ in range(classical.SURE_TICKS)]
    assert answers == [False] * (classical.SURE_TICKS - 1) + [True]


def test_a_missing_sonar_towards_the_goal_is_no_free_way() -> None:
    memory = looking({}, 2.4)
    assert classical.leads_nearer(memory.boundary, DEFAULTS)
    memory.boundary.follower.seen_m[3] = None
    assert not classical.leads_nearer(memory.boundary, DEFAULTS)


@each("side", [states.LEFT, states.RIGHT])
def test_a_disc_is_left_as_soon_as_the_way_is_clear(side: int) -> None:
    walk = walk_to(states.DISTBUG, COURSES_GOAL, [], DISC, side=side)
    assert walk.arrived
    assert len(walk.decisions) < 360
    assert min(clearance_m(pose, [], DISC) for pose in walk.poses) > 0.04


@each("side", [states.LEFT, states.RIGHT])
def test_distbug_enters_and_leaves_a_trap(side: int) -> None:
    walk = walk_to(states.DISTBUG, BEHIND_THE_TRAP, U_TRAP, [], side=side)
    assert walk.arrived
    assert min(clearance_m(pose, U_TRAP) for pose in walk.poses) > 0.04


def test_distbug_finds_a_walled_in_goal_unreachable() -> None:
    assert walk_to(states.DISTBUG, COURSES_GOAL, BOX_AROUND_THE_GOAL, []).gave_up


def test_hidden_way_is_tried_at_the_nearest_point() -> None:
    slalom: list[Wall] = [(0.7, -3.0, 0.7, 0.5), (1.15, -0.5, 1.15, 3.0), (1.6, -3.0, 1.6, 0.5)]
    walk = walk_to(states.DISTBUG, COURSES_GOAL, slalom, [], seconds=300.0)
    assert walk.arrived
    assert min(clearance_m(pose, slalom) for pose in walk.poses) > 0.04


def test_nearest_point_is_tried_once_only() -> None:
    boundary = classical.DistBugMemory().boundary
    boundary.distance_m = boundary.near_m = 1.0
    assert not boundaries.leave_at_nearest(boundary)
    boundary.laps = 1
    boundary.distance_m = 1.2
    assert not boundaries.leave_at_nearest(boundary)
    boundary.distance_m = 1.01
    assert boundaries.leave_at_nearest(boundary)
    assert not boundaries.leave_at_nearest(boundary)
    assert boundary.best_m == inf
