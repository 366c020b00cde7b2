from math import inf

from robot.core import states
from robot.core.navigators import classical
from robot.core.navigators import classical as boundaries
from robot.core.parameters import DEFAULTS
from robot.core.values import Goal
from tests.support.each import each
from tests.support.robot.core.courses import (
    BEHIND_THE_TRAP,
    BOX_AROUND_THE_GOAL,
    DISC,
    GOAL,
    U_TRAP,
)
from tests.support.robot.core.rings import HERE, Wall, clearance_m, ring, walk_to


def looking(echoes: dict[int, int], best_m: float, goal: Goal = GOAL) -> classical.DistBugMemory:
    memory = classical.DistBugMemory()
    for _ in range(3):
        boundaries.look(memory.boundary, HERE, ring(echoes), goal, DEFAULTS)
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
    walk = walk_to(states.DISTBUG, GOAL, [], DISC, side=side)
    assert walk.arrived
    assert len(walk.decisions) < 360
    assert min(clearance_m(pose, [], DISC) for pose in walk.poses) > 0.04


@each("side", [states.LEFT, states.RIGHT])
def test_a_trap_is_entered_and_left(side: int) -> None:
    walk = walk_to(states.DISTBUG, BEHIND_THE_TRAP, U_TRAP, [], side=side)
    assert walk.arrived
    assert min(clearance_m(pose, U_TRAP) for pose in walk.poses) > 0.04


def test_a_goal_that_is_walled_in_is_unreachable() -> None:
    assert walk_to(states.DISTBUG, GOAL, BOX_AROUND_THE_GOAL, []).gave_up


def test_hidden_way_is_tried_at_the_nearest_point() -> None:
    slalom: list[Wall] = [(0.7, -3.0, 0.7, 0.5), (1.15, -0.5, 1.15, 3.0), (1.6, -3.0, 1.6, 0.5)]
    walk = walk_to(states.DISTBUG, GOAL, slalom, [], seconds=300.0)
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
