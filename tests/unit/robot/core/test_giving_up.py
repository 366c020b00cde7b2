"""vgm_memory after a closed loop: head for the goal, reverse the direction, or give up."""

import pytest

from robot.core import states
from robot.core.navigators import loops, vgm_following
from robot.core.navigators import proof as proofs
from robot.core.navigators.proof import NO_GAP, SPENT, WAITING
from robot.core.navigators.vgm_following import EASE_MM, ISLANDS, MAX_LOOPS, Memory
from robot.core.values import Goal
from tests.support.each import each
from tests.support.robot.core.driving import driving
from tests.support.robot.core.rings import HERE, RADIUS_MM, SILENT, Wall, clearance_m, walk_to
from tests.support.robot.core.vgm_memory import GOAL, SIDES, stand


def close_loop(memory: Memory, turn: int, x_cm: int, *, times: int = 1) -> None:
    """Drive a loop of two metres around a place, to the left (1) or to the right (-1).

    The boundary has gaps, so there is no proof.
    """
    corners = [(-100, -100), (100, -100), (100, 100), (-100, 100)][::turn]
    for _ in range(times):
        memory.following, memory.awaits_proof = True, False
        way = memory.loops
        for k, (dx_cm, dy_cm) in enumerate(corners):
            way.place[k] = loops.packed(x_cm + dx_cm, dy_cm)
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
    close_loop(memory, -side, 0, times=ISLANDS - 1)
    assert not memory.lost
    close_loop(memory, -side, 0)
    assert memory.lost
    assert stand(memory, SILENT, 1).branch == states.LOST


@SIDES
@pytest.mark.parametrize(("round_goal", "x_cm"), [(True, 300), (False, 0)])
def test_open_loops_between_robot_and_goal_end_lost(side: int, round_goal: bool, x_cm: int) -> None:
    """Around the goal, or along the inside of a boundary that excludes it, each time reversed."""
    memory = heading_for(GOAL, side)
    for k in range(MAX_LOOPS):
        assert not memory.lost
        assert memory.side == (side if k % 2 == 0 else -side)
        close_loop(memory, -memory.side if round_goal else memory.side, x_cm)
        assert memory.ease_mm == EASE_MM
    assert memory.lost
    assert not memory.given_up
    assert stand(memory, SILENT, 1).branch == states.LOST


@SIDES
def test_one_loop_without_a_gap_waits_for_the_proof(side: int) -> None:
    memory = heading_for(GOAL, side)
    memory.following = memory.awaits_proof = memory.proof.is_valid = True
    memory.loops.count = 4
    vgm_following.close_loop(memory)
    assert (memory.side, memory.following, memory.open_loops) == (side, True, 0)
    assert not memory.awaits_proof
    assert memory.loops.count == 0


@SIDES
@pytest.mark.parametrize(("is_valid", "gap"), [(False, NO_GAP), (True, WAITING), (True, SPENT)])
def test_a_loop_without_a_chain_does_not_wait(side: int, is_valid: bool, gap: int) -> None:
    memory = heading_for(GOAL, side)
    memory.awaits_proof = True
    memory.proof.is_valid, memory.proof.gap = is_valid, gap
    assert not proofs.may_close(memory.proof)
    memory.loops.count = 4
    vgm_following.close_loop(memory)
    assert memory.loops.count == 0
    assert memory.awaits_proof, "of the next boundary"


BOX: list[Wall] = [(2.4, -0.6, 3.6, -0.6), (3.6, -0.6, 3.6, 0.6)]
BOX += [(3.6, 0.6, 2.4, 0.6), (2.4, 0.6, 2.4, -0.6)]


def test_a_walled_in_goal_is_proved_unreachable() -> None:
    walk = walk_to(states.VGM_MEMORY, GOAL, BOX, [], seconds=240.0)
    assert walk.gave_up
    assert min(clearance_m(pose, BOX) for pose in walk.poses) > 0.03


@each("gap_m", [0.20, 0.25, 0.27])
def test_a_post_close_to_the_box_does_not_hinder_the_proof(gap_m: float) -> None:
    """The robot of 0.24 m neither passes the gap nor is certain that it cannot."""
    walk = walk_to(states.VGM_MEMORY, GOAL, BOX, [(3.0, 0.8 + gap_m, 0.2)], seconds=240.0)
    assert walk.gave_up


def test_a_walled_in_robot_proves_the_goal_unreachable() -> None:
    around = [(x0 - 3.0, y0, x1 - 3.0, y1) for x0, y0, x1, y1 in BOX]
    walk = walk_to(states.VGM_MEMORY, GOAL, around, [], seconds=240.0)
    assert walk.gave_up


def test_proof_sees_the_covariance_of_the_odometry() -> None:
    driven = driving()
    odometry = driven.state.odometry
    before_m2 = odometry.pxx
    driven.forward(2.0)
    proof = driven.state.memory.proof
    assert proof.odometry is driven.state.odometry
    assert proof.odometry.pxx > before_m2 > 0.0


def test_repeated_goal_starts_like_a_new_memory() -> None:
    memory = heading_for(GOAL, states.LEFT)
    fresh = Memory()
    stand(fresh, SILENT, 1)
    close_loop(memory, 1, 0)
    vgm_following.begin(memory)
    for name in ("following", "given_up", "lost", "reversed", "awaits_proof", "left_m", "hit_m"):
        assert getattr(memory, name) == getattr(fresh, name)
    for name in ("open_loops", "failed_leaves", "islands", "shut", "ease_mm"):
        assert getattr(memory, name) == getattr(fresh, name) == 0
    assert not memory.proof.is_valid


def test_a_lap_that_separates_nothing_ends_at_the_next_gap_as_a_loop() -> None:
    memory = heading_for(GOAL, states.LEFT)
    memory.following = memory.proof.is_valid = True
    for loop in range(1, MAX_LOOPS + 1):
        memory.proof.is_valid, memory.proof.gap, memory.awaits_proof = True, SPENT, False
        memory.proof.x_mm = 9000  # the chain has stayed far behind
        vgm_following.watch_boundary(memory, HERE, SILENT, RADIUS_MM)
        assert not memory.proof.is_valid
        assert (memory.open_loops, memory.awaits_proof) == (loop, True)
        assert memory.lost == (loop == MAX_LOOPS)
