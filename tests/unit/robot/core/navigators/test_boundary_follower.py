from itertools import pairwise
from math import degrees, inf, pi, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core.navigators import boundary_follower as followers
from robot.core.navigators.boundary_follower import Follower
from robot.core.parameters import DEFAULTS
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Pose, wrap
from tests.support.each import each
from tests.support.robot.core.rings import HERE, Disc, Wall, clearance_m, ring, rolled, seen_from

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


def test_a_wall_beside_is_followed_straight_on() -> None:
    seen = seen_from(HERE, BELOW)
    assert turn_deg(started(HERE, seen, -80.0), HERE, seen) == pytest.approx(0.0, abs=4.0)


def test_too_near_it_steers_away_and_too_far_back() -> None:
    near, far = (
        seen_from(HERE, [(-9.0, -0.18, 9.0, -0.18)]),
        seen_from(HERE, [(-9, -0.32, 9, -0.32)]),
    )
    assert turn_deg(started(HERE, near, -80.0), HERE, near) > 10.0
    assert turn_deg(started(HERE, far, -80.0), HERE, far) < -10.0


def test_an_inner_corner_turns_it_away_from_the_wall() -> None:
    seen = seen_from(HERE, [*BELOW, (0.30, -0.25, 0.30, 3.0)])
    assert turn_deg(started(HERE, seen, -80.0), HERE, seen) > 45.0


def test_a_wall_that_ends_is_remembered_where_the_ring_is_blind() -> None:
    follower = started(HERE, seen_from(HERE, BELOW), -80.0)
    for k in range(10):
        pose = Pose(0.02 * k, 0.0, 0.0)
        followers.sense(follower, pose, seen_from(pose, BELOW), DEFAULTS)
        followers.heading(follower, pose, DEFAULTS)
    beyond = Pose(0.35, 0.0, 0.0)
    assert turn_deg(follower, beyond, ring({})) < -10.0
    assert not follower.lost


def test_points_without_new_echoes_are_dropped_in_the_end() -> None:
    follower = started(HERE, seen_from(HERE, BELOW), -80.0)
    turn_deg(follower, HERE, seen_from(HERE, BELOW))
    turn_deg(follower, HERE, ring({}), followers.OLD_TICKS + 2)
    assert follower.lost


def test_contradicted_points_are_dropped_at_once() -> None:
    ahead = ring({3: 150, 4: 150})
    follower = started(HERE, ahead, 0.0)
    turn_deg(follower, HERE, ahead)
    turn_deg(follower, HERE, ring({3: 2000, 4: 2000}), 8)
    assert follower.lost


def test_walls_all_round_leave_no_way_but_to_turn() -> None:
    box: list[Wall] = [(-0.13, -0.13, 0.13, -0.13), (0.13, -0.13, 0.13, 0.13)]
    box += [(0.13, 0.13, -0.13, 0.13), (-0.13, 0.13, -0.13, -0.13)]
    follower = started(HERE, seen_from(HERE, box), 0.0)
    for k in range(80):
        pose = Pose(0.0, 0.0, wrap(0.1 * k))
        followers.sense(follower, pose, seen_from(pose, box), DEFAULTS)
        turned_rad = followers.heading(follower, pose, DEFAULTS)
        assert follower.boxed or abs(turned_rad) > 0.5


def test_single_false_echo_or_dropout_is_ignored() -> None:
    follower = Follower()
    for range_mm in (1500, 1505, 300, 1498, None, 1502):
        followers.sense(follower, HERE, ring({} if range_mm is None else {4: range_mm}), DEFAULTS)
        seen_m = follower.seen_m[4]
        assert seen_m == pytest.approx(1.5, abs=0.01)
    for _ in range(2):
        followers.sense(follower, HERE, ring({4: 300}), DEFAULTS)
    assert follower.seen_m[4] == 0.3


@each("side", [1, -1])
def test_a_disc_is_circled_at_a_steady_distance(side: int) -> None:
    discs = [(0.7, 0.0, 0.3)]
    poses, follower = walk(HERE, [], discs, 30.0, side)
    clearances = [clearance_m(pose, [], discs) for pose in poses[80:]]
    assert min(clearances) > 0.08
    assert max(clearances) < 0.18
    angles = [wrap(b.heading_rad - a.heading_rad) for a, b in pairwise(poses)]
    assert -side * sum(angles[80:]) > 2.0 * pi
    assert not follower.lost


def test_thin_wall_is_followed_around_its_end() -> None:
    wall: list[Wall] = [(0.4, -3.0, 0.4, 0.5)]
    poses, _ = walk(HERE, wall, [], 25.0)
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


ranges = st.lists(st.one_of(st.none(), st.integers(20, 3000)), min_size=8, max_size=8)
scans = st.lists(ranges, min_size=1, max_size=12)


@given(scans, st.floats(-0.1, 0.1), st.floats(-0.3, 0.3))
def test_left_and_right_are_mirror_images(
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


anything = st.lists(st.sampled_from([None, inf, 0.03, 0.1, 0.25, 0.4, 1.0]), min_size=8, max_size=8)


@given(st.lists(st.tuples(anything, st.floats(-2, 2), st.floats(-4, 4)), max_size=30))
def test_any_scans_anywhere_give_a_bearing_and_no_growing_memory(
    story: list[tuple[list[float | None], float, float]],
) -> None:
    follower, seen = Follower(), Ring()
    followers.start(follower, HERE, 1, 0.0, DEFAULTS)
    for range_m, x_m, heading_rad in story:
        seen.range_m = range_m
        pose = Pose(x_m, 0.0, heading_rad)
        followers.sense(follower, pose, seen, DEFAULTS)
        assert -pi <= followers.heading(follower, pose, DEFAULTS) <= pi
    assert len(follower.points_x_m) == len(follower.points_tick) == followers.POINTS
    assert len(follower.bearing_rad) == followers.POINTS + 9
