"""vgm_memory after a closed loop: head for the goal, reverse the direction, or give up."""

import pytest

from robot.core import states
from robot.core.navigators import vgm_following
from robot.core.navigators.vgm_following import ISLANDS, LONG_CM, Memory
from robot.core.values import Goal
from tests.support.robot.core.rings import SILENT, Wall, clearance_m, walk_to
from tests.support.robot.core.vgm_memory import GOAL, SIDES, stand


def close_loop(memory: Memory, turn: int, x_cm: int, *, times: int = 1) -> None:
    """Drive a loop of two metres around a place, to the left (1) or to the right (-1)."""
    corners = [(-100, -100), (100, -100), (100, 100), (-100, 100)][::turn]
    for _ in range(times):
        memory.following = True
        way = memory.loops
        for k, (dx_cm, dy_cm) in enumerate(corners):
            way.x_cm[k], way.y_cm[k] = x_cm + dx_cm, dy_cm
        way.count, way.first = len(corners), 0
        vgm_following.close_loop(memory)


def heading_for(goal: Goal, side: int) -> Memory:
    memory = Memory()
    stand(memory, SILENT, 1, goal)
    memory.side = side
    return memory


@SIDES
def test_islands_lead_back_to_the_goal_a_limited_number_of_times(side: int) -> None:
    """Circle to the right around an island on the right."""
    memory = heading_for(GOAL, side)
    close_loop(memory, -side, 0)
    assert not memory.following
    assert not memory.given_up
    close_loop(memory, -side, 0, times=ISLANDS)
    assert memory.given_up


@SIDES
@pytest.mark.parametrize(("round_goal", "x_cm"), [(True, 300), (False, 0)])
def test_loop_between_robot_and_goal_proves_unreachability(
    side: int, round_goal: bool, x_cm: int
) -> None:
    """Around the goal, or along the inside of a boundary that excludes it."""
    memory = heading_for(GOAL, side)
    close_loop(memory, -side if round_goal else side, x_cm)
    assert memory.given_up
    assert stand(memory, SILENT, 1).branch == states.GIVE_UP


@SIDES
def test_loop_with_a_reversal_is_repeated_in_reverse(side: int) -> None:
    memory = heading_for(GOAL, side)
    memory.doubtful = True
    close_loop(memory, side, 0)
    assert not memory.given_up
    assert memory.side == -side
    memory.doubtful = True
    close_loop(memory, -side, 0)
    assert memory.given_up


def test_a_long_doubtful_loop_needs_one_proof_more() -> None:
    memory = heading_for(GOAL, states.LEFT)
    for turn in (1, -1):
        memory.doubtful = True
        memory.loops.spacing_cm = LONG_CM
        close_loop(memory, turn, 0)
    assert not memory.given_up


BOX: list[Wall] = [(2.4, -0.6, 3.6, -0.6), (3.6, -0.6, 3.6, 0.6)]
BOX += [(3.6, 0.6, 2.4, 0.6), (2.4, 0.6, 2.4, -0.6)]


def test_a_walled_in_goal_is_given_up() -> None:
    walk = walk_to(states.VGM_MEMORY, GOAL, BOX, [], seconds=240.0)
    assert walk.gave_up
    assert min(clearance_m(pose, BOX) for pose in walk.poses) > 0.03


def test_a_walled_in_robot_gives_up() -> None:
    around = [(x0 - 3.0, y0, x1 - 3.0, y1) for x0, y0, x1, y1 in BOX]
    walk = walk_to(states.VGM_MEMORY, GOAL, around, [], seconds=240.0)
    assert walk.gave_up


def test_repeated_goal_starts_like_a_new_memory() -> None:
    memory = heading_for(GOAL, states.LEFT)
    fresh = Memory()
    stand(fresh, SILENT, 1)
    close_loop(memory, 1, 0)
    vgm_following.begin(memory)
    for name in ("following", "given_up", "reversed", "doubtful", "left_m", "hit_m"):
        assert getattr(memory, name) == getattr(fresh, name)
    for name in ("proofs", "failed_leaves", "islands", "shut", "ease_mm"):
        assert getattr(memory, name) == getattr(fresh, name) == 0
