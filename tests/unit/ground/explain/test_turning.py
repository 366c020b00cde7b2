"""The instants that decided a run, for a timeline and for one key that jumps to the last."""

from protocol.wire.enums import Branch
from protocol.wire.messages import AvoidanceDecision
from protocol.wire.reasons import Reason
from tests.support.ground.explain.decisions import decided, turning_points

TICK_NS = 50_000_000


def run(*branches: Branch, guard: int = 0) -> list[AvoidanceDecision]:
    return [
        decided(time_ns=tick * TICK_NS, branch=branch, guard=guard)
        for tick, branch in enumerate(branches)
    ]


def test_a_run_in_which_nothing_changes_has_no_turning_point() -> None:
    assert turning_points([]) == []
    assert turning_points(run(Branch.TO_GOAL)) == []
    assert turning_points(run(Branch.TO_GOAL, Branch.TO_GOAL)) == []


def test_each_change_of_branch_and_side_is_one_with_its_stamp_and_words() -> None:
    points = turning_points(
        run(Branch.TO_GOAL, Branch.PASS_LEFT, Branch.PASS_LEFT, Branch.PASS_RIGHT)
    )
    assert [(point.time_ns // TICK_NS, point.words) for point in points] == [
        (1, "goes for the goal -> passes on the left"),
        (3, "changes the side: passes on the left -> passes on the right"),
    ]


def test_the_guard_is_one_too() -> None:
    free, slowed = run(Branch.TO_GOAL), run(Branch.TO_GOAL, guard=Reason.SLOWED)
    (point,) = turning_points(free + slowed)
    assert point.words == "guard: nothing -> slowed for an obstacle"
    assert (point.previous, point.decision) == (free[0], slowed[0])
