"""Test the progress to a goal, and that nothing is invented."""

import msgspec
import pytest

from ground.station.history.goal_progress import GoalProgress
from protocol.wire.enums import GoalState, Mode
from protocol.wire.messages import NavigatorStatus
from runtime.units import NS_PER_S
from tests.support.tui.underway import status

BEGUN = 100 * NS_PER_S


def at(time_s: float, distance_m: float, **changes: int) -> NavigatorStatus:
    return msgspec.structs.replace(
        status(BEGUN + round(time_s * NS_PER_S)),
        goal_started_ns=BEGUN,
        goal_distance_m=distance_m,
        **changes,
    )


def driven(progress: GoalProgress, until_s: float, rate_m_s: float = 0.25) -> None:
    for tick in range(round(until_s * 20) + 1):
        progress.update(at(tick / 20, 8.0 - rate_m_s * tick / 20))


def test_share_and_time_left_follow_the_drive() -> None:
    progress = GoalProgress()
    driven(progress, 16.0)
    assert progress.share == pytest.approx(0.5)
    assert progress.left_s == pytest.approx(16.0, rel=0.05)


def test_time_left_is_unknown_without_two_seconds_of_progress() -> None:
    progress = GoalProgress()
    assert (progress.share, progress.left_s) == (None, None)
    driven(progress, 1.5)
    assert progress.left_s is None
    driven(progress, 6.0, rate_m_s=0.0)
    assert progress.left_s is None


def test_share_is_unknown_when_the_start_was_not_seen() -> None:
    progress = GoalProgress()
    for tick in range(100):
        progress.update(at(30.0 + tick / 20, 5.0 - tick / 100))
    assert progress.share is None
    assert progress.left_s is not None


def test_hold_a_new_goal_and_the_end_clear_the_time_left() -> None:
    for changes in ({"mode": Mode.HOLD}, {"goal_id": 8}, {"goal": GoalState.ABORTED}):
        progress = GoalProgress()
        driven(progress, 8.0)
        progress.update(at(8.1, 6.0, **changes))
        assert progress.left_s is None


def test_reached_goal_is_done_although_its_start_was_not_seen() -> None:
    progress = GoalProgress()
    progress.update(at(30.0, 0.02, goal=GoalState.REACHED))
    assert progress.share == 1.0
