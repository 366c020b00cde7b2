"""The instants that decided a run, for a timeline and for one key that jumps to the last."""

from ground.explain import Why, turning_points
from protocol.enums import Branch
from protocol.messages import AvoidanceDecision
from protocol.reasons import Reason
from tests.unit.ground.explain.drives import drive
from tests.unit.ground.explain.told import decided, standing

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


def test_what_is_watched_has_the_turning_points_of_the_run() -> None:
    why = Why()
    moments = drive("box", "vgm")
    for moment in moments:
        why.take(moment.decision, moment.status)
        why.take(moment.decision, moment.status)  # looked at more often than it is told
    points = turning_points([moment.decision for moment in moments])
    assert len(points) > 5
    assert why.points == points
    last = why.at()
    assert last is not None
    assert last[0] == points[-1]
    assert points[-1].words in last[1].lines[-1]


def test_one_key_goes_back_turn_by_turn_and_stops_at_the_first() -> None:
    why = Why(most=2)
    assert why.at() is None
    for decision in run(Branch.TO_GOAL, Branch.PASS_LEFT, Branch.TO_GOAL, Branch.PASS_RIGHT):
        why.take(decision, standing())
    words = [None if (found := why.at(back)) is None else found[0].words for back in range(3)]
    assert words == [
        "goes for the goal -> passes on the right",
        "passes on the left -> goes for the goal",
        None,
    ]
    assert why.at(-1) is None


def test_a_log_that_is_played_from_the_start_again_has_no_turn_between_end_and_start() -> None:
    why = Why()
    for decision in reversed(run(Branch.TO_GOAL, Branch.PASS_LEFT)):
        why.take(decision, None)
    assert why.points == []
