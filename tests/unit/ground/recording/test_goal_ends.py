"""Recordings name how a goal was given up: unreachable, lost or stuck."""

from msgspec.structs import replace

from ground.recording.summary import Mark, changes, outcome, outcome_of
from protocol.wire.enums import GoalState, Mode, Navigator, Vehicle
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason
from tests.support.each import each


def status(goal: int, reason: int = Reason.NONE) -> NavigatorStatus:
    return NavigatorStatus(
        time_ns=0, goal_started_ns=0, goal_ended_ns=0, goal_id=7, goal_x_m=1.0, goal_y_m=2.0,
        goal_heading_rad=0.0, goal_distance_m=3.0, vehicle=Vehicle.ACTIVE, mode=Mode.AUTO,
        goal=goal, vehicle_reason=0, goal_reason=reason, navigator=Navigator.VGM, side=1,
    )  # fmt: skip


@each(
    ("reason", "end", "mark"),
    [
        (Reason.UNREACHABLE, "unreachable", "UNREACHABLE: a closed boundary"),
        (Reason.LOST, "lost", "LOST: found no way"),
        (Reason.BLOCKED, "stuck", "STUCK: has not moved"),
    ],
)
def test_goal_given_up_is_named_by_its_reason(reason: Reason, end: str, mark: str) -> None:
    ended = status(GoalState.STUCK, reason)
    assert outcome_of(ended) == end
    assert outcome(ended).startswith(mark)


def test_other_goal_states_keep_their_names() -> None:
    assert outcome(status(GoalState.REACHED)) == "REACHED"
    assert outcome(status(99, Reason.BUMPER)) == "goal state 99: bumper contact"
    assert outcome_of(status(GoalState.DRIVING)) == "driving"


def test_goal_that_another_one_replaces_has_an_end() -> None:
    first, over = status(GoalState.DRIVING), status(GoalState.REACHED)
    other = replace(first, goal_id=8, goal_x_m=4.0)
    third = replace(first, goal_id=9, goal_x_m=5.0)
    statuses = [
        (0, first),
        (10**9, other),
        (2 * 10**9, replace(over, goal_id=8)),
        (3 * 10**9, third),
    ]
    assert changes(statuses) == [
        Mark(0.0, "goal", "goal 1.00 2.00"),
        Mark(1.0, "outcome", "REPLACED: by the goal 4.00 2.00"),
        Mark(1.0, "goal", "goal 4.00 2.00"),
        Mark(2.0, "outcome", "REACHED"),
        Mark(3.0, "goal", "goal 5.00 2.00"),
    ]
