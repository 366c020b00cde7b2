"""At exit the last drive is told: outcome, time and distance."""

from math import nan

import msgspec

from ground.station.history.goal_progress import LastDrive
from protocol.wire.enums import GoalState
from protocol.wire.messages import NavigatorStatus, PlanarOdometry
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.ground.recording.made import odometry, status

S = 1_000_000_000


def driven(goal: GoalState, *, reason: int = 0, seen_from_ns: int = 1) -> LastDrive:
    drive = LastDrive()
    drive.update(status(seen_from_ns))
    for number in range(5):
        drive.moved(odometry(number * S, 0.6 + number))
    ended = goal >= GoalState.REACHED
    last: NavigatorStatus = msgspec.structs.replace(
        status(30 * S, goal), goal_ended_ns=20 * S if ended else 0, goal_reason=reason
    )
    drive.update(last)
    return drive


def test_a_goal_that_was_reached() -> None:
    assert driven(GoalState.REACHED).text() == (
        "reached the goal (5.400, 2.000) at 0.0 deg with vgm in 20.0 s, 4.00 m driven"
    )


def test_an_aborted_goal_has_its_reason_and_what_was_left() -> None:
    text = driven(GoalState.ABORTED, reason=Reason.BUDGET).text()
    assert text.startswith("aborted: goal (5.400, 2.000)")
    assert ", 4.00 m driven, 1.00 m to go; " in text


def test_a_goal_that_was_not_reached_yet() -> None:
    text = driven(GoalState.DRIVING).text()
    assert text.startswith("was driving to (5.400, 2.000)")
    assert text.endswith("in 30.0 s, 4.00 m driven, 1.00 m to go")


def test_a_path_that_was_not_seen_from_its_start_is_not_counted() -> None:
    assert "driven" not in driven(GoalState.REACHED, seen_from_ns=3 * S).text()


def test_small_moves_are_noise_and_gaps_are_not_added() -> None:
    drive = LastDrive()
    drive.update(status(1))
    for number in range(1000):
        drive.moved(odometry(number, 0.6 + 0.004 * (number % 2)))
    drive.moved(odometry(2000, nan))
    drive.update(status(2 * S))
    assert ", 0.00 m driven" in drive.text()


def test_a_new_goal_begins_a_new_distance() -> None:
    drive = driven(GoalState.REACHED)
    drive.update(msgspec.structs.replace(status(40 * S), goal_id=8, goal_started_ns=40 * S))
    drive.moved(odometry(41 * S, 5.6))
    assert ", 1.00 m driven" in drive.text()


def nowhere(goal: GoalState) -> NavigatorStatus:
    """Return the status of a robot that has accepted no goal yet."""
    return msgspec.structs.replace(
        status(1 * S, goal), goal_id=0, goal_x_m=nan, goal_y_m=nan, goal_reason=Reason.NOT_ARMED
    )


def test_a_refused_goal_without_a_place_is_named_by_its_reason() -> None:
    drive = LastDrive()
    drive.update(nowhere(GoalState.REFUSED))
    assert drive.text().startswith("refused the goal: ")
    assert "nan" not in drive.text()


def lost() -> PlanarOdometry:
    """Return the odometry of a robot that does not know its place."""
    return msgspec.structs.replace(odometry(31 * S, 0.6), cov_xx_m2=nan)


def test_the_drive_before_a_restart_is_the_last_one() -> None:
    drive = driven(GoalState.DRIVING)
    before = drive.text()
    drive.lose_place()
    drive.moved(lost())
    drive.update(nowhere(GoalState.NONE))
    assert drive.text() == f"{before}; then the robot restarted, PLACE UNKNOWN"
    drive.update(nowhere(GoalState.REFUSED))
    assert drive.text() == f"{before}; then the robot restarted, PLACE UNKNOWN"
    drive.moved(odometry(32 * S, 0.6))
    assert drive.text() == f"{before}; then the robot restarted"


def test_a_goal_after_a_restart_is_the_last_one() -> None:
    drive = driven(GoalState.DRIVING)
    drive.update(nowhere(GoalState.NONE))
    drive.update(msgspec.structs.replace(status(40 * S), goal_id=8, goal_started_ns=40 * S))
    assert "restarted" not in drive.text()
    assert ", 0.00 m driven" in drive.text()


@each(("drive", "words"), [(LastDrive(), "no status was received"), (None, "no goal was set")])
def test_without_a_goal(drive: LastDrive | None, words: str) -> None:
    if drive is None:
        drive = LastDrive()
        drive.update(status(1, GoalState.NONE))
    assert drive.text() == words
