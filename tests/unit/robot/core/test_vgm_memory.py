"""vgm_memory: the remembered boundary, and what follows a closed loop."""

from math import atan2, hypot, inf, nan, pi
from typing import Final

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from robot.core import states
from robot.core.navigators import evasion as flank_walkers
from robot.core.navigators import loops, vgm_following
from robot.core.navigators import proof as proofs
from robot.core.navigators.pace import DITHER_RAD, DITHER_TURNS, SLOW_MM
from robot.core.navigators.proof import NO_GAP, SPENT, WAITING
from robot.core.navigators.vgm_following import DWELL, EASE_MM, ISLANDS, MAX_LOOPS, VgmMemory
from robot.core.navigators.vgm_memory import MAX_FAILED_LEAVES, MAX_STILL, rotation_rad
from robot.core.parameters import DEFAULTS
from robot.core.perception import sonar_ring as rings
from robot.core.perception.echoes import MAX_WEIGHT, REACH_M, SURE
from robot.core.perception.sonar_ring import Ring
from robot.core.ring import SONARS
from robot.core.values import Goal, Pose, Scan, wrap
from tests.support.cores import (
    GOAL_AHEAD,
    HERE,
    RADIUS_MM,
    SIDES,
    SILENT,
    Disc,
    Wall,
    clearance_m,
    driving,
    ring,
    stand,
    step,
    walk_to,
)
from tests.support.each import each

PASSING = {states.PASS_LEFT, states.PASS_RIGHT}


def contents(thing: object) -> object:
    """Return all contents of a memory, for comparison."""
    slots = getattr(thing, "__slots__", ())
    if not slots:
        return repr(thing)
    return {name: contents(getattr(thing, name)) for name in slots}


def size(thing: object) -> int:
    """Return the number of values in a memory."""
    slots = getattr(thing, "__slots__", ())
    if slots:
        return sum(size(getattr(thing, name)) for name in slots)
    return len(thing) if isinstance(thing, list | bytearray | tuple) else 1


def branch_of(side: int) -> int:
    return states.PASS_LEFT if side == states.LEFT else states.PASS_RIGHT


def slanting(side: int) -> Ring:
    """Return an obstacle in the way that needs a smaller turn on this side."""
    echoes = {4: 150, 3: 130, 2: 160, 1: 220}
    return ring({i if side == states.LEFT else 7 - i: mm for i, mm in echoes.items()})


places = st.floats(-8.0, 8.0)
poses = st.builds(Pose, places, places, st.floats(-pi, pi))
far = st.lists(st.floats(REACH_M + 0.01, 3.0), min_size=SONARS, max_size=SONARS)


@given(st.lists(st.tuples(poses, far), min_size=1, max_size=20), places, places)
def test_with_nothing_near_the_goal_itself_is_the_virtual_one(
    story: list[tuple[Pose, list[float]]], x_m: float, y_m: float
) -> None:
    memory, goal = VgmMemory(), Goal(x_m, y_m, None, 0.05, 0.05)
    for pose, range_m in story:
        seen = ring({i: round(1000.0 * range_m[i]) for i in range(SONARS)})
        decision = step(memory, pose, seen, goal)
        assert decision.branch == states.TO_GOAL
        off_m = hypot(decision.virtual_x_m - pose.x_m, decision.virtual_y_m - pose.y_m)
        assert abs(decision.rotation_rad) in (0.0, DITHER_RAD)
        assert off_m == pytest.approx(hypot(x_m - pose.x_m, y_m - pose.y_m), abs=1e-9)
        if decision.rotation_rad == 0.0:
            there_m = (decision.virtual_x_m, decision.virtual_y_m)
            assert there_m == pytest.approx((x_m, y_m), abs=1e-9)


near = st.lists(st.one_of(st.integers(20, 400), st.just(0)), min_size=SONARS, max_size=SONARS)


@given(poses, near, places, places)
def test_virtual_goal_is_the_rotated_goal(
    pose: Pose, range_mm: list[int], x_m: float, y_m: float
) -> None:
    memory, goal = VgmMemory(), Goal(x_m, y_m, None, 0.05, 0.05)
    seen = ring({i: mm for i, mm in enumerate(range_mm) if mm})
    for _ in range(6):
        decision = step(memory, pose, seen, goal)
        dx_m, dy_m = decision.virtual_x_m - pose.x_m, decision.virtual_y_m - pose.y_m
        distance_m = hypot(x_m - pose.x_m, y_m - pose.y_m)
        assert hypot(dx_m, dy_m) == pytest.approx(distance_m, abs=1e-9)
        if distance_m > 1e-3:
            turn_rad = decision.goal_bearing_rad + decision.rotation_rad
            bearing_rad = atan2(dy_m, dx_m) - pose.heading_rad
            assert abs(wrap(bearing_rad - turn_rad)) < 1e-6


@SIDES
def test_obstacle_is_passed_on_the_side_of_less_rotation(side: int) -> None:
    discs: list[Disc] = [(1.5, -0.22 * side, 0.3)]
    walk = walk_to(states.VGM_MEMORY, GOAL_AHEAD, [], discs)
    assert walk.arrived
    assert walk.branches & PASSING == {branch_of(side)}
    assert max(side * pose.y_m for pose in walk.poses) > 0.1
    assert min(clearance_m(pose, [], discs) for pose in walk.poses) > 0.03


@SIDES
def test_the_side_is_latched_until_the_obstacle_is_left(side: int) -> None:
    """Keep the side even if the other one would now need less rotation."""
    memory = VgmMemory()
    seen = slanting(side)
    assert stand(memory, seen, 12).branch == branch_of(side)
    assert memory.following
    turned = slanting(-side)
    assert stand(memory, turned, 40).branch == branch_of(side)


@SIDES
def test_at_the_same_place_the_other_side_is_tried_next(side: int) -> None:
    memory = VgmMemory()
    stand(memory, SILENT, 1)
    loops.remember(memory.loops, 0, 0, side)
    seen = slanting(side)
    assert stand(memory, seen, 8).branch == branch_of(-side)


def test_one_far_echo_alone_turns_nothing() -> None:
    memory, seen = VgmMemory(), ring({3: 200})
    assert stand(memory, seen, 1).branch == states.TO_GOAL
    assert stand(memory, SILENT, 20).branch == states.TO_GOAL
    assert stand(memory, seen, 8).branch in PASSING


@SIDES
def test_one_near_echo_alone_turns_the_robot_aside(side: int) -> None:
    memory = VgmMemory()
    stand(memory, slanting(side), 1)
    assert stand(memory, SILENT, 20).branch == branch_of(side)


def alongside(best_m: float) -> VgmMemory:
    """Follow a wall on the right, with an open way to the goal."""
    memory = VgmMemory()
    beside = ring({0: 130})
    stand(memory, beside, 8)
    memory.following, memory.side = True, states.LEFT
    memory.anchor_x_mm, memory.anchor_y_mm = memory.echoes.x_mm[0], memory.echoes.y_mm[0]
    memory.best_m = best_m
    return memory


def test_obstacle_is_left_where_the_way_leads_nearer() -> None:
    assert stand(alongside(inf), ring({0: 130}), 2).branch == states.TO_GOAL


def test_free_range_counts_only_until_too_many_failed_leaves() -> None:
    memory = alongside(1.0)
    assert stand(memory, ring({0: 130}), 2).branch == states.TO_GOAL
    doubtful = alongside(1.0)
    doubtful.failed_leaves = MAX_FAILED_LEAVES
    assert stand(doubtful, ring({0: 130}), 2).branch == states.PASS_LEFT


def test_without_progress_the_obstacle_is_followed_on() -> None:
    """Place an obstacle far ahead on the way to the goal, which limits the free distance."""
    memory = alongside(1.0)
    assert stand(memory, ring({0: 130, 3: 900, 4: 900}), 2).branch == states.PASS_LEFT


TRAP: list[Wall] = [(0.8, 0.5, 2.0, 0.5), (2.0, 0.5, 2.0, -0.5), (2.0, -0.5, 0.8, -0.5)]


def test_a_trap_is_entered_and_left() -> None:
    walk = walk_to(states.VGM_MEMORY, GOAL_AHEAD, TRAP, [])
    assert walk.arrived
    assert max(pose.x_m for pose in walk.poses if abs(pose.y_m) < 0.4) > 1.5
    assert min(clearance_m(pose, TRAP) for pose in walk.poses) > 0.03


def test_a_disc_is_passed_by_a_small_detour() -> None:
    discs: list[Disc] = [(1.5, 0.02, 0.25)]
    walk = walk_to(states.VGM_MEMORY, GOAL_AHEAD, [], discs)
    assert walk.arrived
    assert max(abs(pose.y_m) for pose in walk.poses) < 0.7
    assert min(clearance_m(pose, [], discs) for pose in walk.poses) > 0.03


def test_a_goal_just_before_a_wall_is_driven_to() -> None:
    wall: list[Wall] = [(3.2, -1.0, 3.2, 1.0)]
    assert walk_to(states.VGM_MEMORY, GOAL_AHEAD, wall, []).arrived


def test_shut_in_robot_looks_around_and_drops_echoes_that_are_gone() -> None:
    memory = VgmMemory()
    ghosts = ring(dict.fromkeys(range(SONARS), 30))
    for k in range(80):
        step(memory, Pose(0.0, 0.0, wrap(0.1 * k)), ghosts)
    assert memory.following
    counts, k = [], 80
    while memory.dwell >= 0 and k < 80 + 3 * DWELL:
        k += 1
        step(memory, Pose(0.0, 0.0, wrap(0.1 * k)), SILENT)
    for more in range(70):
        step(memory, Pose(0.0, 0.0, wrap(0.1 * (k + more))), SILENT)
        counts.append(memory.echoes.count)
    assert 0 in counts
    assert not memory.given_up


@SIDES
def test_pedestrian_alongside_is_let_ahead(side: int) -> None:
    memory, x_m = VgmMemory(), 0.0
    beside = ring({7: 100, 6: 2500} if side == states.LEFT else {0: 100, 1: 2500})
    while memory.flank_walker.ticks == 0 and x_m < 1.0:
        x_m += 0.01
        step(memory, Pose(x_m, 0.0, 0.0), beside)
    decisions = [step(memory, Pose(x_m, 0.0, 0.0), SILENT) for _ in range(80)]
    assert wrap(decisions[0].goal_bearing_rad + decisions[0].rotation_rad) * side < -1.0
    waits = [decision.speed_limit_m_s == 0.0 for decision in decisions]
    assert waits[flank_walkers.DRIVE_TICKS + 2]
    assert decisions[-1].branch == states.TO_GOAL
    assert decisions[-1].speed_limit_m_s > 0.0


def test_new_goal_resets_all_but_the_echoes() -> None:
    memory = VgmMemory()
    stand(memory, slanting(states.LEFT), 8)
    memory.given_up, points = True, memory.echoes.count
    assert points > 0
    assert stand(memory, SILENT, 1).branch == states.GIVE_UP
    behind = Goal(-3.0, 0.0, None, 0.05, 0.05)
    assert stand(memory, SILENT, 1, behind).branch == states.TO_GOAL
    assert not memory.following
    assert memory.loops.hits == 0
    assert memory.best_m == 3.0
    assert memory.echoes.count == points
    assert max(memory.echoes.weight) >= SURE


@each(
    "pose",
    [
        Pose(nan, 0.0, 0.0),
        Pose(0.0, inf, 0.0),
        Pose(0.0, 0.0, nan),
        Pose(0.0, 0.0, -inf),
        Pose(1e300, 0.0, 0.0),
        Pose(0.0, 0.0, 1e300),
    ],
)
def test_invalid_pose_stops_it_and_is_not_stored(pose: Pose) -> None:
    memory = VgmMemory()
    seen = slanting(states.LEFT)
    stand(memory, seen, 8)
    before = contents(memory)
    decision = step(memory, pose, seen)
    assert decision.speed_limit_m_s == 0.0
    assert contents(memory) == before
    assert stand(memory, seen, 1).branch == states.PASS_LEFT


@each("x_m", [nan, inf, -inf])
def test_a_goal_that_is_nowhere_is_not_driven_to(x_m: float) -> None:
    decision = step(VgmMemory(), HERE, SILENT, Goal(x_m, 0.0, None, 0.05, 0.05))
    assert decision.speed_limit_m_s == 0.0


masks = st.integers(0, 255)
some_range = st.one_of(st.integers(20, 400), st.integers(20, 3000), st.sampled_from([nan, inf, -1]))
scans = st.builds(Scan, st.tuples(*[some_range] * SONARS), st.just((0,) * SONARS), masks, masks)
wild = st.one_of(poses, st.builds(Pose, st.floats(), st.floats(), st.floats()))


TURNED: Final = Pose(0.0, 0.0, 1001.0)
"""A heading for which there is no sine."""


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(scans, wild, st.integers(1, 9)), max_size=30), places, places)
@example([(Scan((20,) * SONARS, (0,) * SONARS, 1, 1), TURNED, 1)], 0.0, 0.0)
def test_any_inputs_give_a_decision_and_constant_memory(
    story: list[tuple[Scan, Pose, int]], x_m: float, y_m: float
) -> None:
    memory, seen, now_ms = VgmMemory(), Ring(), 0
    goal = Goal(x_m, y_m, None, 0.05, 0.05)
    step(memory, HERE, seen, goal)
    held = size(memory)
    for scan, pose, ticks in story:
        for _ in range(ticks):
            now_ms += 50
            rings.update(seen, scan, now_ms, DEFAULTS)
            decision = step(memory, pose, seen, goal)
            assert 0.0 <= decision.speed_limit_m_s <= DEFAULTS.v_max_m_s
            assert states.TO_GOAL <= decision.branch <= states.LOST
            assert -pi <= decision.rotation_rad <= pi
    assert size(memory) == held


def test_heading_without_progress_is_blocked_in_the_end() -> None:
    """Show a way to the sonars on which the robot cannot move, as between two close edges."""
    memory = VgmMemory()
    assert stand(memory, SILENT, 3 * MAX_STILL).branch == states.TO_GOAL
    assert stand(memory, SILENT, 6).branch in PASSING
    assert memory.echoes.weight[0] > MAX_WEIGHT
    x_m = 0.0
    moving = VgmMemory()
    for _ in range(5 * MAX_STILL):
        x_m += 0.005
        assert step(moving, Pose(x_m, 0.0, 0.0), SILENT).branch == states.TO_GOAL


def test_while_following_a_slow_way_sweeps_the_cones() -> None:
    memory = VgmMemory()
    memory.following, memory.rotation = True, 512
    rotations = {}
    for free_mm in (SLOW_MM, SLOW_MM - 1):
        memory.sectors.free_mm = free_mm
        for memory.echoes.turn in (0, DITHER_TURNS):
            rotations[free_mm, memory.echoes.turn] = rotation_rad(
                memory, SILENT, states.PASS_LEFT, 3.0, 0.0
            )
    assert rotations[SLOW_MM, 0] == rotations[SLOW_MM, DITHER_TURNS] == pi / 4
    swept = sorted((rotations[SLOW_MM - 1, 0], rotations[SLOW_MM - 1, DITHER_TURNS]))
    assert swept == pytest.approx([pi / 4 - DITHER_RAD, pi / 4 + DITHER_RAD])


def close_loop(memory: VgmMemory, turn: int, x_cm: int, *, times: int = 1) -> None:
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


def heading_for(goal: Goal, side: int) -> VgmMemory:
    memory = VgmMemory()
    stand(memory, SILENT, 1, goal)
    memory.side = side
    return memory


@SIDES
def test_islands_lead_back_to_the_goal_a_limited_number_of_times(side: int) -> None:
    """Circle to the right around an island on the right."""
    memory = heading_for(GOAL_AHEAD, side)
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
    memory = heading_for(GOAL_AHEAD, side)
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
    memory = heading_for(GOAL_AHEAD, side)
    memory.following = memory.awaits_proof = memory.proof.is_valid = True
    memory.loops.count = 4
    vgm_following.close_loop(memory)
    assert (memory.side, memory.following, memory.open_loops) == (side, True, 0)
    assert not memory.awaits_proof
    assert memory.loops.count == 0


@SIDES
@pytest.mark.parametrize(("is_valid", "gap"), [(False, NO_GAP), (True, WAITING), (True, SPENT)])
def test_a_loop_without_a_chain_does_not_wait(side: int, is_valid: bool, gap: int) -> None:
    memory = heading_for(GOAL_AHEAD, side)
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
    walk = walk_to(states.VGM_MEMORY, GOAL_AHEAD, BOX, [], seconds=240.0)
    assert walk.gave_up
    assert min(clearance_m(pose, BOX) for pose in walk.poses) > 0.03


@each("gap_m", [0.20, 0.25, 0.27])
def test_a_post_close_to_the_box_does_not_hinder_the_proof(gap_m: float) -> None:
    """The robot of 0.24 m neither passes the gap nor is certain that it cannot."""
    walk = walk_to(states.VGM_MEMORY, GOAL_AHEAD, BOX, [(3.0, 0.8 + gap_m, 0.2)], seconds=240.0)
    assert walk.gave_up


def test_a_walled_in_robot_proves_the_goal_unreachable() -> None:
    around = [(x0 - 3.0, y0, x1 - 3.0, y1) for x0, y0, x1, y1 in BOX]
    walk = walk_to(states.VGM_MEMORY, GOAL_AHEAD, around, [], seconds=240.0)
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
    memory = heading_for(GOAL_AHEAD, states.LEFT)
    fresh = VgmMemory()
    stand(fresh, SILENT, 1)
    close_loop(memory, 1, 0)
    vgm_following.begin(memory)
    for name in ("following", "given_up", "lost", "reversed", "awaits_proof", "left_m", "hit_m"):
        assert getattr(memory, name) == getattr(fresh, name)
    for name in ("open_loops", "failed_leaves", "islands", "dwell", "ease_mm"):
        assert getattr(memory, name) == getattr(fresh, name) == 0
    assert not memory.proof.is_valid


def test_a_lap_that_separates_nothing_ends_at_the_next_gap_as_a_loop() -> None:
    memory = heading_for(GOAL_AHEAD, states.LEFT)
    memory.following = memory.proof.is_valid = True
    for loop in range(1, MAX_LOOPS + 1):
        memory.proof.is_valid, memory.proof.gap, memory.awaits_proof = True, SPENT, False
        memory.proof.x_mm = 9000  # the chain has stayed far behind
        vgm_following.watch_boundary(memory, HERE, SILENT, RADIUS_MM)
        assert not memory.proof.is_valid
        assert (memory.open_loops, memory.awaits_proof) == (loop, True)
        assert memory.lost == (loop == MAX_LOOPS)
