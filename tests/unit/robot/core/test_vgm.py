"""vgm: headings, following a flank; and the registry of navigators."""

from math import atan2, cos, degrees, hypot, inf, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.navigators import NAVIGATORS as NAMES
from protocol.wire.enums import Navigator as Numbers
from robot.core import reasons, states
from robot.core.navigators import classical, registry, vgm_and_bug, vgm_following
from robot.core.navigators.registry import NAVIGATORS, Navigator
from robot.core.navigators.vgm_and_bug import PaperMemory
from robot.core.navigators.vgm_following import (
    EASE_MM,
    FAR_M,
    LEFT_SONARS,
    MAX_LOOPS,
    RIGHT_SONARS,
    VgmMemory,
)
from robot.core.parameters import DEFAULTS
from robot.core.perception.sonar_ring import Ring
from robot.core.ring import BEARINGS, SONARS
from robot.core.values import Decision, Goal, Pose, wrap
from tests.support.cores import AHEAD, SIDES, armed, heard, ring
from tests.support.each import each

places = st.floats(-20.0, 20.0)
poses = st.builds(Pose, places, places, st.floats(-pi, pi))


def goal(x_m: float, y_m: float) -> Goal:
    return Goal(x_m, y_m, None, 0.05, 0.05)


def decide(pose: Pose, seen: Ring, x_m: float, y_m: float) -> Decision:
    return vgm_and_bug.step_vgm(PaperMemory(), pose, seen, goal(x_m, y_m), DEFAULTS)


def bearing_of_virtual_goal(pose: Pose, decision: Decision) -> float:
    dx_m, dy_m = decision.virtual_x_m - pose.x_m, decision.virtual_y_m - pose.y_m
    return wrap(atan2(dy_m, dx_m) - pose.heading_rad)


@given(poses, st.integers(0, 7), st.integers(20, 299), st.floats(-pi, pi), st.floats(0.1, 20))
def test_virtual_goal_keeps_distance_and_is_tangent(
    pose: Pose, sonar: int, range_mm: int, goal_at_rad: float, distance_m: float
) -> None:
    x_m, y_m = pose.x_m + distance_m * cos(goal_at_rad), pose.y_m + distance_m * sin(goal_at_rad)
    decision = decide(pose, ring({sonar: range_mm}), x_m, y_m)
    virtual_m = hypot(decision.virtual_x_m - pose.x_m, decision.virtual_y_m - pose.y_m)
    assert virtual_m == pytest.approx(distance_m, abs=1e-9)
    tangent_rad = bearing_of_virtual_goal(pose, decision)
    away_rad = wrap(tangent_rad - BEARINGS[sonar])
    assert abs(away_rad) == pytest.approx(pi / 2, abs=1e-6)
    obstacle_left = BEARINGS[sonar] > 0
    assert (away_rad < 0) == obstacle_left  # it stays on the side it is on
    assert decision.branch == (states.PASS_RIGHT if obstacle_left else states.PASS_LEFT)


def test_an_obstacle_ahead_on_the_left_is_passed_on_the_right() -> None:
    decision = decide(Pose(0.0, 0.0, 0.0), ring({4: 250}), 3.0, 0.0)
    assert degrees(decision.rotation_rad) == pytest.approx(11.25 - 90)
    assert decision.virtual_y_m < 0.0
    assert decision.nearest_bearing_rad == BEARINGS[4]


def test_outside_the_avoidance_zone_nothing_is_rotated() -> None:
    for echoes in ({}, {3: 301}, {3: 300}):
        decision = decide(Pose(1.0, 1.0, 0.5), ring(echoes), 3.0, -1.0)
        assert decision.branch == states.TO_GOAL
        assert decision.rotation_rad == 0.0
        assert (decision.virtual_x_m, decision.virtual_y_m) == (3.0, -1.0)


def test_only_the_nearest_echo_counts() -> None:
    one = decide(Pose(0.0, 0.0, 0.0), ring({6: 150}), 3.0, 0.0)
    many = decide(Pose(0.0, 0.0, 0.0), ring({6: 150, 1: 160, 3: 280, 7: 200}), 3.0, 0.0)
    assert many == one


@given(poses, st.integers(0, 7), places, places)
def test_rotation_about_the_robot_is_independent_of_the_map(
    pose: Pose, sonar: int, shift_x_m: float, shift_y_m: float
) -> None:
    seen = ring({sonar: 200})
    here = decide(pose, seen, pose.x_m + 2.0, pose.y_m + 1.0)
    moved = Pose(pose.x_m + shift_x_m, pose.y_m + shift_y_m, pose.heading_rad)
    there = decide(moved, seen, moved.x_m + 2.0, moved.y_m + 1.0)
    assert wrap(there.rotation_rad - here.rotation_rad) == pytest.approx(0.0, abs=1e-9)
    assert there.virtual_x_m - shift_x_m == pytest.approx(here.virtual_x_m, abs=1e-9)


def test_it_has_no_memory() -> None:
    memory, pose = PaperMemory(), Pose(0.0, 0.0, 0.0)
    first = vgm_and_bug.step_vgm(memory, pose, ring({}), goal(3.0, 0.0), DEFAULTS)
    for _ in range(50):
        vgm_and_bug.step_vgm(memory, pose, ring({2: 100}), goal(3.0, 0.0), DEFAULTS)
    assert vgm_and_bug.step_vgm(memory, pose, ring({}), goal(3.0, 0.0), DEFAULTS) == first


def test_room_is_summed_over_the_sonars_of_a_flank() -> None:
    seen = heard([0.1, 0.2, 0.3, 0.4, 1.0, 1.0, 1.0, 2.0])
    assert vgm_following.room_m(seen, RIGHT_SONARS) == pytest.approx(1.0)
    assert vgm_following.room_m(seen, LEFT_SONARS) == pytest.approx(5.0)
    assert sorted((*RIGHT_SONARS, *LEFT_SONARS)) == list(range(SONARS))


def test_free_range_counts_as_far_and_missing_one_as_none() -> None:
    seen = heard([inf, FAR_M + 1.0, None, 0.5, None, None, None, None])
    assert vgm_following.room_m(seen, RIGHT_SONARS) == pytest.approx(2.0 * FAR_M + 0.5)
    assert vgm_following.room_m(seen, LEFT_SONARS) == 0.0


@SIDES
def test_other_side_is_tried_with_smaller_margins(side: int) -> None:
    memory = VgmMemory()
    memory.side, memory.following, memory.proof.is_valid = side, True, True
    memory.loops.count = 5
    vgm_following.try_other_side(memory, 1)
    assert (memory.side, memory.ease_mm) == (-side, EASE_MM)
    assert (memory.following, memory.awaits_proof, memory.lost) == (True, True, False)
    assert not memory.proof.is_valid
    assert memory.loops.count == 0


@each("weight", [1, 2])
def test_robot_is_lost_after_enough_loops_by_weight(weight: int) -> None:
    memory, tries = VgmMemory(), 0
    while not memory.lost:
        vgm_following.try_other_side(memory, weight)
        tries += 1
        assert tries <= MAX_LOOPS
    assert tries * weight == MAX_LOOPS
    assert not memory.given_up


def test_every_navigator_of_the_dialect_is_registered() -> None:
    assert {*NAVIGATORS, states.OWN} == {int(number) for number in Numbers}
    assert {NAMES[name] for name in NAMES} == {*Numbers} - {Numbers.OWN}


@each("number", NAVIGATORS)
@each("side", [states.LEFT, states.RIGHT])
def test_new_memory_has_the_requested_side(number: int, side: int) -> None:
    one, other = registry.new_memory(number, side), registry.new_memory(number, side)
    assert one is not other
    assert one.side == side


@each("number", NAVIGATORS)
def test_every_navigator_drives_through_open_space_to_the_goal(number: int) -> None:
    driven = armed(DEFAULTS._replace(navigator=number))
    assert driven.goto() == reasons.OK
    driven.forward(20.0)
    assert driven.machine.goal_state == states.REACHED


def test_a_goal_takes_the_memory_of_the_navigator_that_is_chosen() -> None:
    driven = armed()
    driven.machine.navigator = states.BUG2
    assert driven.goto() == reasons.OK
    first = driven.forward(0.1).state.memory
    assert isinstance(first, classical.Bug2Memory)
    assert driven.forward(0.1).state.memory is first
    assert driven.goto() == reasons.OK
    assert driven.forward(0.1).state.memory is not first


def chosen(branch: int, speed_limit_m_s: float) -> Navigator:
    """Return a step with a constant decision."""

    def step(*_: object, **__: object) -> Decision:
        return Decision(branch, None, 9.0, 0.0, 0.0, AHEAD.x_m, AHEAD.y_m, speed_limit_m_s)

    return Navigator(NAVIGATORS[states.BUG].memory, step, True)


def test_giving_up_ends_the_goal_stuck_because_it_is_unreachable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(NAVIGATORS, DEFAULTS.navigator, chosen(states.GIVE_UP, 0.3))
    driven = armed()
    assert driven.goto() == reasons.OK
    driven.forward(1.0)
    machine = driven.machine
    assert (machine.goal_state, machine.goal_reason) == (states.STUCK, reasons.UNREACHABLE)
    assert driven.stands


def test_the_speed_limit_of_a_navigator_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(NAVIGATORS, DEFAULTS.navigator, chosen(states.TO_GOAL, 0.07))
    driven = armed()
    assert driven.goto() == reasons.OK
    driven.forward(2.0)
    assert driven.outputs.twist.speed_m_s == pytest.approx(0.07)


def test_navigator_judging_progress_has_no_time_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ends = []
    for judges in (True, False):
        turning = chosen(states.TO_GOAL, 0.0)
        moving = Navigator(turning.memory, turning.step, judges)
        monkeypatch.setitem(NAVIGATORS, DEFAULTS.navigator, moving)
        driven = armed(DEFAULTS._replace(progress_ms=1000))
        assert driven.goto() == reasons.OK
        driven.forward(2.0)
        ends.append(driven.machine.goal_reason)
    assert ends == [reasons.OK, reasons.NO_PROGRESS]
