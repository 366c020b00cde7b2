from math import atan2, cos, degrees, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core import states
from robot.core.navigators import paper, registry
from robot.core.navigators.paper import PaperMemory
from robot.core.parameters import DEFAULTS
from robot.core.values import Decision, Goal, Pose, wrap
from tests.support.each import each
from tests.support.robot.core.rings import ring

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
    return paper.step_bug(remembered, HERE, ring(echoes), goal, DEFAULTS)


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
        paper.step_bug(remembered, pose, ring({}), far_behind, DEFAULTS)
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
