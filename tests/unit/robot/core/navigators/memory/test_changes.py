from hypothesis import given
from hypothesis import strategies as st

from plant.corpus.generate import generate
from robot.core import states
from robot.core.navigators import loops, vgm_memory
from robot.core.navigators.loops import MAX_CHANGES, MAX_DETOUR_CHANGES
from robot.core.navigators.vgm_following import Memory
from study.trial.core_loop import Behaviour
from study.trial.trial import Trial, run_trial

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
    memory = Memory()
    memory.side = memory.aside = RIGHT
    for k in range(MAX_CHANGES + 1):
        assert loops.are_left(memory.passed)
        vgm_memory.count_side(memory, BRANCHES[LEFT if k % 2 == 0 else RIGHT])
    assert not loops.are_left(memory.passed)
    assert (memory.side, memory.aside) == (LEFT, LEFT)


def test_branches_that_pass_nothing_do_not_count() -> None:
    memory = Memory()
    for branch in (states.TO_GOAL, states.GIVE_UP, states.LOST, states.NO_BRANCH):
        vgm_memory.count_side(memory, branch)
    assert memory.passed == 0


def test_trial_with_many_obstacles_stays_within_the_limit() -> None:
    """Drive through a lattice in which the side would change 7 times without a limit."""
    watch, world = Behaviour(), generate("post_lattice", 1, 8102)
    outcome = run_trial(Trial(world=world, noise="none", timeout_s=900.0), watch)
    assert outcome.reached
    assert 0 < watch.side_changes <= MAX_CHANGES
