from math import hypot

from robot.core import states
from robot.core.navigators import classical
from robot.core.parameters import DEFAULTS
from robot.core.values import Goal, Pose
from tests.support.each import each
from tests.support.robot.core.courses import BOX_AROUND_THE_GOAL, DISC, FAR, GOAL
from tests.support.robot.core.rings import clearance_m, ring, seen_from, walk_to


def test_with_a_free_way_it_drives_straight_to_the_goal() -> None:
    walk = walk_to(states.BUG1, GOAL, [], [])
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
    walk = walk_to(states.BUG1, GOAL, BOX_AROUND_THE_GOAL, [])
    assert walk.gave_up
    assert min(clearance_m(pose, BOX_AROUND_THE_GOAL) for pose in walk.poses) > 0.05


def test_a_new_goal_forgets_the_old_one() -> None:
    memory = classical.Bug1Memory()
    here, ahead = Pose(0.0, 0.0, 0.0), ring({3: 150, 4: 150})
    for _ in range(5):
        classical.step_bug1(memory, here, ahead, GOAL, DEFAULTS)
    assert memory.phase == classical.CIRCLING
    other = Goal(-2.0, 0.0, None, 0.05, 0.05)
    decision = classical.step_bug1(memory, here, seen_from(here, []), other, DEFAULTS)
    assert memory.phase == classical.GOING
    assert decision.branch == states.TO_GOAL
