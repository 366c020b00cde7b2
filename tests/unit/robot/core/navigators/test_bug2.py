from robot.core import states
from robot.core.navigators import classical
from robot.core.parameters import DEFAULTS
from robot.core.values import Pose
from tests.support.each import each
from tests.support.robot.core.courses import (
    BEHIND_THE_TRAP,
    BOX_AROUND_THE_GOAL,
    DISC,
    FAR,
    GOAL,
    U_TRAP,
)
from tests.support.robot.core.rings import Disc, Wall, clearance_m, ring, walk_to


def test_an_obstacle_ahead_is_met_only_when_it_is_seen_twice() -> None:
    memory, here = classical.Bug2Memory(), Pose(0.0, 0.0, 0.0)
    ahead = ring({3: 180, 4: 180})
    assert classical.step_bug2(memory, here, ahead, GOAL, DEFAULTS).branch == states.TO_GOAL
    assert classical.step_bug2(memory, here, ahead, GOAL, DEFAULTS).branch == states.PASS_LEFT


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
    assert not classical.crosses(memory, Pose(1.0, 0.2, 0.0), GOAL)
    assert classical.crosses(memory, Pose(1.0, -0.2, 0.0), GOAL)
    assert not classical.crosses(memory, Pose(1.1, -0.2, 0.0), GOAL)


def test_a_goal_that_is_walled_in_is_unreachable() -> None:
    assert walk_to(states.BUG2, GOAL, BOX_AROUND_THE_GOAL, []).gave_up


def test_walled_in_robot_gives_up() -> None:
    room: list[Wall] = [(-0.7, -0.7, 0.7, -0.7), (0.7, -0.7, 0.7, 0.7)]
    room += [(0.7, 0.7, -0.7, 0.7), (-0.7, 0.7, -0.7, -0.7)]
    assert walk_to(states.BUG2, GOAL, room, []).gave_up


def test_disc_before_a_reachable_goal_is_passed() -> None:
    posts: list[Disc] = [(0.8, 0.0, 0.06), (1.3, 0.1, 0.06), (1.8, -0.1, 0.06)]
    walk = walk_to(states.BUG2, GOAL, [], posts)
    assert walk.arrived
    assert min(clearance_m(pose, [], posts) for pose in walk.poses) > 0.02
