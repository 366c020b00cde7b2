"""What a station remembers: trail, decisions, events, progress, series, all bounded."""

import tracemalloc
from dataclasses import dataclass
from math import inf, isfinite, isnan, nan, pi

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from checks.harness.messages import make
from ground.station.history.decision_history import DecisionHistory, Frames
from ground.station.history.event_log import EventLog, Inbox, LogLine, ReceivedFrame
from ground.station.history.goal_progress import GoalProgress, LastDrive
from ground.station.history.telemetry_history import HELD, SonarGaps, WorstCycle, uncertainty_m
from ground.station.history.time_series import SERIES, Series, SeriesTable
from ground.station.history.trail import BoundaryMarks, DrivenPath, EchoGrid, ranges_m
from protocol.topics import DECISION
from protocol.wire.codec import Encoder
from protocol.wire.enums import GoalState, Mode, Severity
from protocol.wire.messages import CycleReport, NavigatorStatus, PlanarOdometry, SonarScan
from protocol.wire.reasons import Reason
from runtime.units import NS_PER_S
from runtime.units import NS_PER_S as S
from tests.support.app import status
from tests.support.each import each
from tests.support.ground.made_recordings import odometry
from tests.support.ground.made_recordings import status as recording_status
from tests.support.ground.station import Play, Robot


def test_moment_has_its_decision_and_the_previous_one() -> None:
    play = Play()
    for step in range(40):
        play.robot.rotation_rad = step / 8
        play.robot.x_m = step / 8
        play.forward(0.05)
    moment = play.station.moment(1000 * S + 500_000_000)
    assert moment is not None
    assert moment.decision.rotation_rad == 10 / 8
    assert moment.previous is not None
    assert moment.previous.rotation_rad == 9 / 8
    assert moment.status is not None
    assert moment.cycle is not None
    assert moment.cycle.tick == 10


def test_moment_defaults_to_now() -> None:
    play = Play().forward(1.0)
    moment = play.station.moment()
    assert moment is not None
    assert moment.time_ns == play.station.now_ns


def test_moment_is_none_outside_the_history() -> None:
    play = Play().forward(1.0)
    play.hang()
    play.forward(3.0)
    assert play.station.moment() is None
    assert play.station.moment(999 * S) is None
    assert play.station.moment(1001 * S) is not None


def test_decisions_between_polls_are_kept() -> None:
    play = Play().forward(1.0)
    play.forward(0.5, poll=False)
    play.station.poll()
    moment = play.station.moment(1001 * S + 200_000_000)
    assert moment is not None
    assert moment.time_ns == 1001 * S + 200_000_000


def test_malformed_frames_are_skipped() -> None:
    frames = Frames()
    frames.add(Encoder(1, 1).encode(Robot().decision()), 1)
    frames.add(b"noise", 2)
    assert [arrived_ns for arrived_ns, _ in frames.until(5)] == [1]


def test_ten_minutes_at_50_hz_are_bounded() -> None:
    decision_history, encoder, robot = DecisionHistory(), Encoder(1, 1), Robot()
    tracemalloc.start()
    for number in range(2 * 12_000):
        decision_history.take(
            ReceivedFrame(DECISION.path, encoder.encode(robot.decision()), number)
        )
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 5_000_000


def test_full_inbox_keeps_the_newest() -> None:
    inbox = Inbox(size=3)
    take = inbox.taker("a")
    for number in range(5):
        take("key", bytes([number]), number)
    arrivals, overflowed = inbox.drain()
    assert [arrival.frame for arrival in arrivals] == [b"\2", b"\3", b"\4"]
    assert overflowed
    assert inbox.drain() == ([], False)


def line(number: int, severity: int = Severity.INFO) -> LogLine:
    return LogLine(number / 10, severity, "r1", f"event {number}")


def test_since_returns_new_lines() -> None:
    log = EventLog()
    for number in range(3):
        log.add(line(number))
    seen = log.total
    log.add(line(3))
    assert [found.text for found in log.since(seen)] == ["event 3"]
    assert log.since(log.total) == []


def test_late_reader_gets_the_kept_lines() -> None:
    log = EventLog(size=2)
    for number in range(5):
        log.add(line(number))
    assert [found.text for found in log.since(0)] == ["event 3", "event 4"]
    assert log.total == 5
    assert [found.text for found in log.last(1)] == ["event 4"]


def test_find_ignores_case_and_filters_by_severity() -> None:
    log = EventLog()
    log.add(line(1))
    log.add(LogLine(0.0, Severity.ERROR, "r2", "Scan lost"))
    assert [found.source for found in log.find("SCAN")] == ["r2"]
    assert [found.source for found in log.find("r2")] == ["r2"]
    assert len(log.find("", Severity.ERROR)) == 1


def test_each_severity_has_its_letter() -> None:
    assert [line(0, severity).letter for severity in Severity] == list("EEEEWIID")
    assert line(0, 99).letter == "D"


def test_log_memory_is_bounded() -> None:
    log = EventLog()
    for number in range(10_000):
        log.add(line(number))
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    for number in range(100_000):
        log.add(line(number))
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(log) == 10_000
    assert after - before < 4_000_000  # all kept lines are new


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


def last_drive(goal: GoalState, *, reason: int = 0, seen_from_ns: int = 1) -> LastDrive:
    drive = LastDrive()
    drive.update(recording_status(seen_from_ns))
    for number in range(5):
        drive.moved(odometry(number * S, 0.6 + number))
    ended = goal >= GoalState.REACHED
    last: NavigatorStatus = msgspec.structs.replace(
        recording_status(30 * S, goal), goal_ended_ns=20 * S if ended else 0, goal_reason=reason
    )
    drive.update(last)
    return drive


def test_a_goal_that_was_reached() -> None:
    assert last_drive(GoalState.REACHED).text() == (
        "reached the goal (5.400, 2.000) at 0.0 deg with vgm in 20.0 s, 4.00 m driven"
    )


def test_an_aborted_goal_has_its_reason_and_what_was_left() -> None:
    text = last_drive(GoalState.ABORTED, reason=Reason.BUDGET).text()
    assert text.startswith("aborted: goal (5.400, 2.000)")
    assert ", 4.00 m driven, 1.00 m to go; " in text


def test_a_goal_that_was_not_reached_yet() -> None:
    text = last_drive(GoalState.DRIVING).text()
    assert text.startswith("was driving to (5.400, 2.000)")
    assert text.endswith("in 30.0 s, 4.00 m driven, 1.00 m to go")


def test_a_path_that_was_not_seen_from_its_start_is_not_counted() -> None:
    assert "driven" not in last_drive(GoalState.REACHED, seen_from_ns=3 * S).text()


def test_small_moves_are_noise_and_gaps_are_not_added() -> None:
    drive = LastDrive()
    drive.update(recording_status(1))
    for number in range(1000):
        drive.moved(odometry(number, 0.6 + 0.004 * (number % 2)))
    drive.moved(odometry(2000, nan))
    drive.update(recording_status(2 * S))
    assert ", 0.00 m driven" in drive.text()


def test_a_new_goal_begins_a_new_distance() -> None:
    drive = last_drive(GoalState.REACHED)
    drive.update(
        msgspec.structs.replace(recording_status(40 * S), goal_id=8, goal_started_ns=40 * S)
    )
    drive.moved(odometry(41 * S, 5.6))
    assert ", 1.00 m driven" in drive.text()


def test_the_next_item_of_a_mission_is_another_goal() -> None:
    progress, drive = GoalProgress(), last_drive(GoalState.DRIVING)
    driven(progress, 16.0)
    following = at(16.1, 4.0)
    following = msgspec.structs.replace(
        following, goal_x_m=1.0, goal_started_ns=following.time_ns, goal_id=7
    )
    progress.update(following)
    assert progress.share == 0.0
    drive.update(following)
    assert ", 0.00 m driven" in drive.text()


def nowhere(goal: GoalState) -> NavigatorStatus:
    """Return the status of a robot that has accepted no goal yet."""
    return msgspec.structs.replace(
        recording_status(1 * S, goal),
        goal_id=0,
        goal_x_m=nan,
        goal_y_m=nan,
        goal_reason=Reason.NOT_ARMED,
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
    drive = last_drive(GoalState.DRIVING)
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
    drive = last_drive(GoalState.DRIVING)
    drive.update(nowhere(GoalState.NONE))
    drive.update(
        msgspec.structs.replace(recording_status(40 * S), goal_id=8, goal_started_ns=40 * S)
    )
    assert "restarted" not in drive.text()
    assert ", 0.00 m driven" in drive.text()


@each(("drive", "words"), [(LastDrive(), "no status was received"), (None, "no goal was set")])
def test_without_a_goal(drive: LastDrive | None, words: str) -> None:
    if drive is None:
        drive = LastDrive()
        drive.update(recording_status(1, GoalState.NONE))
    assert drive.text() == words


def scan(valid: int) -> SonarScan:
    return make(SonarScan, range_mm=(500,) * 8, valid=valid, echo=255)


def test_sonar_with_gaps_is_silent_steadily_and_until_it_is_well() -> None:
    gaps = SonarGaps()
    assert gaps.silent == 0
    for number in range(3 * HELD):
        gaps.add(scan(0xFB if number % 3 == 0 else 0xFF))
        assert gaps.silent == 0x04
    for _ in range(HELD - 1):
        gaps.add(scan(0xFF))
    assert gaps.silent == 0


def test_silent_sonar_has_no_range_although_the_newest_scan_has_one() -> None:
    found = list(ranges_m(scan(0xFF), 0x04))
    assert found[2] is None
    assert found[3] == 0.5


def test_last_minute_is_kept_in_full() -> None:
    series = Series()
    for tick in range(1200):
        series.add(tick / 20, float(tick))
    assert len(series.points()) == 1200
    assert series.last == (1199 / 20, 1199.0)


def test_older_points_keep_extremes_per_half_second() -> None:
    series = Series(full=20)
    for tick in range(2000):
        series.add(tick / 20, 100.0 if tick == 777 else -5.0 if tick == 778 else 1.0)
    values = [value for _, value in series.points()]
    assert 100.0 in values
    assert -5.0 in values
    assert len(values) < 20 + 2 * 200 + 2


def test_times_never_decrease() -> None:
    series = Series(full=20)
    for tick in range(999):
        series.add(tick / 20, float(tick % 7))
    times = [time_s for time_s, _ in series.points()]
    assert times == sorted(times)


def test_series_of_ten_minutes_at_50_hz_is_bounded() -> None:
    series = Series()
    for tick in range(2 * 600 * 50):
        series.add(tick / 50, float(tick % 11))
    assert len(series.points()) <= 1200 + 2400 + 2
    assert series.points(since_s=1190.0)[0][0] >= 1190.0


def test_gap_is_marked_once_and_survives_thinning() -> None:
    series = Series(full=4)
    series.gap()
    assert series.points() == []
    for time_s in (0.0, 0.1):
        series.add(time_s, 1.0)
    series.gap()
    series.gap()
    for tick in range(10):
        series.add(5.0 + tick, 2.0)
    assert sum(isnan(value) for _, value in series.points()) == 1


def test_all_series_exist_by_name() -> None:
    history = SeriesTable()
    assert tuple(history) == SERIES
    history["speed"].add(1.0, 0.3)
    assert history["speed"].last == (1.0, 0.3)
    assert history["late_us"].last is None


def cycle(spent_us: int, tick: int = 0) -> CycleReport:
    return make(CycleReport, tick=tick, budget_us=2500, stage_us=(spent_us, 0, 0, 0, 0))


def shown(*spent: tuple[float, int]) -> list[int]:
    """Return the cost shown after each cycle of given time and cost."""
    worst_cycle, found = WorstCycle(), []
    for time_s, spent_us in spent:
        worst_cycle.add(cycle(spent_us), time_s)
        assert worst_cycle.cycle is not None
        found.append(sum(worst_cycle.cycle.stage_us))
    return found


def test_worst_cycle_of_a_second_is_shown() -> None:
    assert shown((0.0, 30), (0.2, 20), (0.4, 40), (0.6, 35)) == [30, 30, 40, 40]


def test_worst_cycle_stays_for_the_next_second() -> None:
    assert shown((0.0, 90), (1.0, 20), (1.5, 30), (2.0, 10), (2.5, 25), (3.0, 5)) == [
        90, 90, 90, 30, 30, 25,
    ]  # fmt: skip


def test_worst_cycle_is_dropped_after_a_silence() -> None:
    assert shown((0.0, 90), (5.0, 20)) == [90, 20]


def test_no_worst_cycle_before_the_first() -> None:
    assert WorstCycle().cycle is None


@dataclass
class Jittery(Robot):
    """A robot whose cycles cost between 15 and 24 us."""

    def cycle(self) -> CycleReport:
        return cycle(15 + self.tick % 10, self.tick)


@each("seconds", [2.0, 5.0])
def test_worst_cycle_of_a_standing_robot_is_stable(seconds: float) -> None:
    play = Play()
    play.robots = [Jittery()]
    play.forward(1.0)
    first = play.station.worst_cycle
    assert first is not None
    assert sum(first.stage_us) == 24
    for _ in range(round(seconds * 20)):
        play.forward(0.05)
        found = play.station.worst_cycle
        assert found is not None
        assert sum(found.stage_us) == 24


def test_restarted_robot_starts_with_its_own_cycles() -> None:
    play = Play()
    play.robots = [Jittery()]
    play.forward(2.0)
    play.robots = [Robot()]
    play.forward(0.05)
    found = play.station.worst_cycle
    assert found is not None
    assert sum(found.stage_us) == 15


NUMBERS = st.floats(width=32)


def pose(x_m: float = 0.0, y_m: float = 0.0, heading_rad: float = 0.0) -> PlanarOdometry:
    return make(
        PlanarOdometry, x_m=x_m, y_m=y_m, heading_rad=heading_rad, cov_xx_m2=0.04, cov_yy_m2=0.01
    )


def test_standing_robot_extends_no_trail() -> None:
    trail = DrivenPath()
    for _ in range(100):
        trail.add(1.0, 2.0)
    assert trail.points() == ((1.0, 2.0),)


def test_long_trail_gets_coarser_but_keeps_its_start() -> None:
    trail = DrivenPath(size=100)
    for step in range(5000):
        trail.add(step * 0.03, 0.0)
    points = trail.points()
    assert 50 <= len(points) <= 100
    assert points[0] == (0.0, 0.0)
    assert points[-1][0] > 140.0


def test_trail_is_one_object_until_it_grows() -> None:
    trail = DrivenPath()
    trail.add(0.0, 0.0)
    assert trail.points() is trail.points()


@given(st.lists(st.tuples(NUMBERS, NUMBERS)))
def test_trail_contains_finite_positions_only(
    places: list[tuple[float, float]],
) -> None:
    trail = DrivenPath(size=10)
    for x_m, y_m in places:
        trail.add(x_m, y_m)
    assert len(trail.points()) <= 10
    assert all(isfinite(x_m) and isfinite(y_m) for x_m, y_m in trail.points())


def test_echoes_lie_in_the_direction_of_the_sonars() -> None:
    echoes = EchoGrid()
    echoes.scan(Robot().scan(), pose(1.0, 1.0, pi / 2), radius_m=0.12, time_s=0.0)
    points = echoes.by_age(0.0).newest
    assert len(points) == 4
    assert all(abs((x - 1.0) ** 2 + (y - 1.0) ** 2 - 1.12**2) < 1e-9 for x, y in points)
    assert points[0][0] > 1.9  # rightmost sonar of a robot that faces upwards


def test_repeated_echoes_add_no_points() -> None:
    echoes = EchoGrid()
    for _ in range(50):
        echoes.scan(Robot().scan(), pose(), radius_m=0.12, time_s=0.0)
    shown = echoes.by_age(0.0).newest
    echoes.scan(Robot().scan(), pose(0.001), radius_m=0.12, time_s=0.0)
    assert len(shown) == 4
    assert echoes.by_age(0.0).newest is shown


def test_echoes_unseen_for_longest_are_dropped() -> None:
    echoes = EchoGrid(size=10)
    for step in range(100):
        echoes.add(step * 1.0, 0.0, 0.0)
        echoes.add(0.0, 0.0, 0.0)
    points = echoes.by_age(0.0).newest
    assert len(points) == 10
    assert (0.0, 0.0) in points
    assert (99.0, 0.0) in points


def test_echoes_age_and_are_renewed_when_seen_again() -> None:
    echoes = EchoGrid()
    for time_s in (0.0, 10.0, 26.0):
        echoes.add(time_s, 0.0, time_s)
    points = {time_s: (time_s, 0.0) for time_s in (0.0, 10.0, 26.0)}
    assert echoes.by_age(29.0) == ((points[26.0],), (points[10.0],), (points[0.0],))
    echoes.add(0.0, 0.0, 29.5)
    assert echoes.by_age(30.0) == ((points[26.0], points[0.0]), (), (points[10.0],))


def test_echoes_of_one_second_are_added_at_the_end() -> None:
    echoes = EchoGrid()
    for time_s in (0.0, 10.0, 26.0):
        echoes.add(time_s, 0.0, time_s)
    before = echoes.by_age(29.0)
    echoes.add(5.0, 5.0, 29.2)
    after = echoes.by_age(29.5)
    assert after.newest == (*before.newest, (5.0, 5.0))
    assert after.late is before.late
    assert after.old is before.old
    assert echoes.by_age(30.0).newest == after.newest


def test_echo_without_a_pose_is_ignored() -> None:
    echoes = EchoGrid()
    echoes.scan(Robot().scan(), pose(nan), radius_m=0.12, time_s=0.0)
    assert echoes.by_age(0.0).newest == ()


def test_no_echo_is_infinite_and_no_measurement_missing() -> None:
    assert list(ranges_m(Robot().scan())) == [1.0, 1.0, 1.0, 1.0, inf, inf, inf, None]


def test_hit_and_leave_points_belong_to_one_goal() -> None:
    marks, robot = BoundaryMarks(), Robot(goal_id=1)
    way = (
        (0.0, GoalState.DRIVING), (1.0, GoalState.AVOIDING), (2.0, GoalState.AVOIDING),
        (3.0, GoalState.DRIVING), (4.0, GoalState.AVOIDING), (5.0, GoalState.STUCK),
    )  # fmt: skip
    for x_m, robot.goal in way:
        marks.update(robot.status(), pose(x_m))
    assert list(marks.hit) == [(1.0, 0.0), (4.0, 0.0)]
    assert list(marks.leave) == [(3.0, 0.0)]
    robot.goal_id, robot.goal = 2, GoalState.DRIVING
    marks.update(robot.status(), pose(6.0))
    assert (list(marks.hit), list(marks.leave)) == ([], [])


@each(
    ("xx", "xy", "yy", "expected"),
    [(0.04, 0.0, 0.01, 0.2), (0.01, 0.0, 0.04, 0.2), (0.02, 0.02, 0.02, 0.2), (0.0, 0.0, 0.0, 0.0)],
)
def test_uncertainty_is_the_longer_semi_axis(
    xx: float, xy: float, yy: float, expected: float
) -> None:
    found = PlanarOdometry(
        **{**{name: getattr(pose(), name) for name in pose().__struct_fields__},
           "cov_xx_m2": xx, "cov_xy_m2": xy, "cov_yy_m2": yy}
    )  # fmt: skip
    assert uncertainty_m(found) == pytest.approx(expected)


@given(NUMBERS, NUMBERS, NUMBERS)
def test_uncertainty_accepts_any_covariance(xx: float, xy: float, yy: float) -> None:
    found = PlanarOdometry(
        **{**{name: getattr(pose(), name) for name in pose().__struct_fields__},
           "cov_xx_m2": xx, "cov_xy_m2": xy, "cov_yy_m2": yy}
    )  # fmt: skip
    assert not uncertainty_m(found) < 0.0
