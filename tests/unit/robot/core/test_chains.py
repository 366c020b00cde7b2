"""Chains of remembered echoes: what is linked, what the robot fits through, and changes."""

from math import cos, hypot, pi, sin
from typing import NamedTuple

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from plant.corpus.generate import generate
from robot.core import states
from robot.core.navigators import loops, vgm_memory
from robot.core.navigators import proof as chains
from robot.core.navigators.loops import MAX_CHANGES, MAX_DETOUR_CHANGES
from robot.core.navigators.proof import JUMP_MM, LEAD, REACH_M, SLACK_MM, TAIL, Chain
from robot.core.navigators.vgm_following import VgmMemory
from robot.core.ring import BEARINGS, HALF_CONE, SONARS
from robot.core.values import Pose
from study.trial.core_loop import Behaviour
from study.trial.trial import Trial, run_trial
from tests.support.cores import HERE, RADIUS_MM, SILENT, Wall, ring, seen_from
from tests.support.cores import SIDES as VGM_MEMORY_SIDES
from tests.support.each import each

WIDTH_M = 0.001 * 2 * RADIUS_MM
SLACK_M = 0.001 * SLACK_MM
WIDTH_MM2 = (2 * RADIUS_MM - SLACK_MM) ** 2
ROUNDING_M = 0.006
"""Ends of arcs are whole millimetres, made of directions in 1024ths."""


def look(chain: Chain, echoes: dict[int, int], pose: Pose = HERE, times: int = 2) -> None:
    for _ in range(times):
        chains.look(chain, ring(echoes), pose, pose, RADIUS_MM)


def arcs(chain: Chain) -> set[int]:
    return {i for i in range(SONARS) if chain.seen >> i & 1}


class Echo(NamedTuple):
    """A range of a sonar at a pose."""

    sonar: int
    range_mm: int
    pose: Pose

    def point_m(self, share: float) -> tuple[float, float]:
        """Return a point of the arc, from its right edge (-1) to its left one (1)."""
        angle_rad = self.pose.heading_rad + BEARINGS[self.sonar] + share * HALF_CONE
        away_m = 0.001 * (self.range_mm + RADIUS_MM)
        return self.pose.x_m + away_m * cos(angle_rad), self.pose.y_m + away_m * sin(angle_rad)


def is_linked(one: Echo, other: Echo) -> bool:
    chain = Chain()
    look(chain, {one.sonar: one.range_mm}, one.pose)
    chains.take(chain, TAIL, one.sonar)
    look(chain, {other.sonar: other.range_mm}, other.pose)
    return chains.is_linked(chain, TAIL, other.sonar, WIDTH_MM2)


def gap_m(one: Echo, other: Echo, share: float, other_share: float) -> float:
    (x1_m, y1_m), (x2_m, y2_m) = one.point_m(share), other.point_m(other_share)
    return hypot(x2_m - x1_m, y2_m - y1_m)


offsets = st.floats(-0.4, 0.4)
echoes = st.builds(
    Echo,
    st.integers(0, SONARS - 1),
    st.integers(20, int(1000.0 * REACH_M) - 1),
    st.builds(Pose, offsets, offsets, st.floats(-pi, pi)),
)
shares = st.floats(-1.0, 1.0)


@given(echoes, echoes, shares, shares)
def test_gap_as_wide_as_the_robot_is_no_link(
    one: Echo, other: Echo, share: float, other_share: float
) -> None:
    """Whatever two points of the arcs the surfaces touch."""
    assume(gap_m(one, other, share, other_share) >= WIDTH_M)
    assert not is_linked(one, other)


@given(echoes, st.integers(0, SONARS - 1), st.integers(-150, 150), offsets)
def test_arcs_without_room_for_the_robot_are_linked(
    one: Echo, sonar: int, nearer_mm: int, turn_rad: float
) -> None:
    """Link two arcs exactly if no two of their points are as far apart as the robot is wide."""
    pose = Pose(one.pose.x_m, one.pose.y_m, one.pose.heading_rad + turn_rad)
    other = Echo(sonar, min(max(one.range_mm - nearer_mm, 20), 399), pose)
    steps = [k / 8.0 - 1.0 for k in range(17)]
    longest_m = max(gap_m(one, other, share, another) for share in steps for another in steps)
    assume(abs(longest_m - WIDTH_M + SLACK_M) > ROUNDING_M)
    assert is_linked(one, other) == (longest_m < WIDTH_M - SLACK_M)


def test_an_echo_counts_only_if_the_last_scan_had_it_too() -> None:
    chain = Chain()
    look(chain, {3: 200}, times=1)
    assert arcs(chain) == set()
    look(chain, {3: 200 + JUMP_MM}, times=1)
    assert arcs(chain) == set()
    look(chain, {3: 201}, times=1)
    assert arcs(chain) == {3}
    look(chain, {}, times=1)
    assert arcs(chain) == set()


def test_a_false_echo_nearer_than_the_wall_beside_it_does_not_count() -> None:
    """Such an echo bridged an opening of 0.36 m: zigzag 4 of corpus seed 13, harsh noise."""
    chain = Chain()
    look(chain, {1: 174, 2: 132, 3: 164}, times=1)
    look(chain, {1: 157, 2: 59}, times=1)
    assert arcs(chain) == {1}


@each(("sonar", "counts"), [(1, False), (2, True), (4, True), (5, False)])
def test_the_last_echo_may_be_of_the_sonar_beside(sonar: int, counts: bool) -> None:
    chain = Chain()
    look(chain, {sonar: 210}, times=1)
    look(chain, {3: 200}, times=1)
    assert arcs(chain) == ({3} if counts else set())


def test_far_echoes_are_no_arcs() -> None:
    chain = Chain()
    look(chain, {0: int(1000.0 * REACH_M), 4: int(1000.0 * REACH_M) - 1})
    assert arcs(chain) == {4}


def test_even_sonars_were_pinged_halfway() -> None:
    chain, seen = Chain(), ring({0: 100, 7: 100})
    for _ in range(2):
        chains.look(chain, seen, HERE, Pose(0.04, 0.0, 0.0), RADIUS_MM)
    assert (chain.x_mm[0], chain.y_mm[0]) == pytest.approx((20, -220), abs=1)
    assert (chain.left_x_mm[7], chain.left_y_mm[7]) == pytest.approx((40, 220), abs=1)


@VGM_MEMORY_SIDES
def test_chain_begins_at_the_followed_flank(side: int) -> None:
    chain = Chain()
    look(chain, {1: 100, 3: 300, 6: 100})
    assert chains.begin(chain, side)
    flank = 1 if side == states.LEFT else 6
    for end in (TAIL, LEAD):
        assert (chain.x_mm[end], chain.y_mm[end]) == (chain.x_mm[flank], chain.y_mm[flank])


@VGM_MEMORY_SIDES
def test_chain_does_not_begin_without_an_echo(side: int) -> None:
    chain = Chain()
    chains.look(chain, SILENT, HERE, HERE, RADIUS_MM)
    assert not chains.begin(chain, side)


@VGM_MEMORY_SIDES
def test_chain_meets_its_first_arc_only_near_it(side: int) -> None:
    chain, flank = Chain(), 0 if side == states.LEFT else 7
    look(chain, {flank: 100})
    assert chains.begin(chain, side)
    assert chains.meets_start(chain, RADIUS_MM)
    for away_m, meets in ((0.1, True), (0.5, False), (0.05, True)):
        look(chain, {flank: 100}, Pose(away_m, 0.0, 0.0))
        for end in (TAIL, LEAD):
            chains.take(chain, end, flank)
        assert chains.meets_start(chain, RADIUS_MM) == meets


def test_lead_is_the_last_linked_arc_and_tail_the_first() -> None:
    """In a corner: sonars 0 to 4 have linked echoes, sonar 7 has one far from them."""
    chain = Chain()
    look(chain, {0: 60, 1: 60, 2: 60, 3: 60, 4: 60, 7: 60})
    assert chains.begin(chain, states.LEFT)
    assert chains.extend(chain, 0, 0, states.LEFT, chains.chain_width_mm(RADIUS_MM))
    assert (chain.x_mm[TAIL], chain.y_mm[TAIL]) == (chain.x_mm[0], chain.y_mm[0])
    assert (chain.x_mm[LEAD], chain.y_mm[LEAD]) == (chain.x_mm[4], chain.y_mm[4])


@given(st.lists(st.integers(20, 399), min_size=SONARS, max_size=SONARS), st.integers(1, 255))
def test_spread_reaches_every_arc_connected_by_links(ranges_mm: list[int], begun: int) -> None:
    chain, expected = Chain(), begun
    look(chain, dict(enumerate(ranges_mm)))
    for _ in range(SONARS):
        for i in range(SONARS):
            for k in range(max(i - 2, 0), min(i + 3, SONARS)):
                if expected >> i & 1 and chains.is_linked(chain, i, k, WIDTH_MM2):
                    expected |= 1 << k
    assert chains.spread(chain, begun, chain.seen, WIDTH_MM2) == expected


def end_after(walls: list[Wall], from_m: float, to_m: float, side: int) -> float | None:
    """Drive along y = 0 with a wall at the flank; return where the chain ends, None if broken."""
    chain, begun = Chain(), False
    for k in range(round((to_m - from_m) / 0.015)):
        x_m = from_m + 0.015 * k
        pose, before = Pose(x_m, 0.0, 0.0), Pose(x_m - 0.015, 0.0, 0.0)
        chains.look(chain, seen_from(pose, walls), before, pose, RADIUS_MM)
        if not begun:
            begun = chains.begin(chain, side)
        else:
            chains.extend(chain, int(1000.0 * x_m), 0, side, chains.chain_width_mm(RADIUS_MM))
    x_mm, _ = chains.middle(chain, TAIL)
    return 0.001 * x_mm if begun else None


def wall_with_gap(gap_m: float, aside_m: float, side: int) -> list[Wall]:
    """Return a wall with a gap from x = 0 on, at this distance from the robot's rim."""
    y_m = -side * (0.001 * RADIUS_MM + aside_m)
    return [(-2.0, y_m, 0.0, y_m), (gap_m, y_m, 2.0, y_m)]


@VGM_MEMORY_SIDES
@given(st.floats(0.30, 0.8), st.floats(0.03, 0.2))
def test_chain_does_not_lead_past_a_gap_for_the_robot(
    side: int, width_m: float, aside_m: float
) -> None:
    ended_m = end_after(wall_with_gap(width_m, aside_m, side), -0.6, 1.4, side)
    assert ended_m is not None
    assert ended_m < 0.5 * width_m


@VGM_MEMORY_SIDES
@pytest.mark.parametrize("width_m", [0.0, 0.08])
def test_chain_follows_a_wall_also_past_a_narrow_gap(side: int, width_m: float) -> None:
    ended_m = end_after(wall_with_gap(width_m, 0.06, side), -0.6, 1.4, side)
    assert ended_m is not None
    assert ended_m > 1.2


LEFT, RIGHT = states.LEFT, states.RIGHT
BRANCHES = {LEFT: states.PASS_LEFT, RIGHT: states.PASS_RIGHT}
SIDES = st.sampled_from([LEFT, RIGHT])


def after(sides: list[int]) -> int:
    """Return the state after obstacles were passed on these sides."""
    passed = 0
    for side in sides:
        passed = loops.counted(passed, side)
    return passed


@given(st.lists(SIDES, min_size=1, max_size=40))
def test_state_holds_last_side_and_number_of_changes(sides: list[int]) -> None:
    passed = after(sides)
    changed = sum(sides[k] != sides[k - 1] for k in range(1, len(sides)))
    assert abs(passed) == 1 + changed
    assert loops.last(passed) == sides[-1]


@given(st.lists(SIDES, max_size=200))
def test_wanted_sides_change_at_most_as_often_as_allowed(wanted: list[int]) -> None:
    passed, taken = 0, []
    for side in wanted:
        taken.append(loops.kept(passed, side, MAX_CHANGES))
        passed = loops.counted(passed, taken[-1])
    assert sum(taken[k] != taken[k - 1] for k in range(1, len(taken))) <= MAX_CHANGES


def test_detours_keep_their_side_before_boundaries_do() -> None:
    passed = after([LEFT, RIGHT] * 2 + [LEFT])
    assert abs(passed) - 1 > MAX_DETOUR_CHANGES
    assert loops.kept(passed, RIGHT, MAX_DETOUR_CHANGES) == LEFT
    assert loops.kept(passed, RIGHT, MAX_CHANGES) == RIGHT


def test_any_side_is_taken_before_the_first_obstacle() -> None:
    assert [loops.kept(0, side, MAX_CHANGES) for side in (LEFT, RIGHT)] == [LEFT, RIGHT]


def test_navigator_latches_both_sides_after_the_last_change() -> None:
    memory = VgmMemory()
    memory.side = memory.aside = RIGHT
    for k in range(MAX_CHANGES + 1):
        assert loops.are_left(memory.passed)
        vgm_memory.count_side(memory, BRANCHES[LEFT if k % 2 == 0 else RIGHT])
    assert not loops.are_left(memory.passed)
    assert (memory.side, memory.aside) == (LEFT, LEFT)


def test_branches_that_pass_nothing_do_not_count() -> None:
    memory = VgmMemory()
    for branch in (states.TO_GOAL, states.GIVE_UP, states.LOST, states.NO_BRANCH):
        vgm_memory.count_side(memory, branch)
    assert memory.passed == 0


def test_trial_with_many_obstacles_stays_within_the_limit() -> None:
    """Drive through a lattice in which the side would change 7 times without a limit."""
    watch, world = Behaviour(), generate("post_lattice", 1, 8102)
    outcome = run_trial(Trial(world=world, noise="none", timeout_s=900.0), watch)
    assert outcome.reached
    assert 0 < watch.side_changes <= MAX_CHANGES
