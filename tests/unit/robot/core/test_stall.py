"""Wheels that do not turn as commanded, and the watches that notice it."""

from math import cos, pi, sin

import pytest

from robot.core import motion as progresses
from robot.core import reasons
from robot.core.motion import SQUARE_M, ProgressMonitor
from robot.core.parameters import DEFAULTS
from robot.core.perception import stall as stalls
from robot.core.perception.odometry import Odometry
from robot.core.perception.stall import ENOUGH_M, Stall, Wheel
from robot.core.values import Pose
from runtime.units import PERIOD_MS
from tests.support.each import each

COMMAND_M_S = 0.2
COMMAND_M = COMMAND_M_S * DEFAULTS.period_s
TIME_MS = DEFAULTS.wheel_time_ms
TRACK_M = DEFAULTS.track_m


def commanded(speed_m_s: float = COMMAND_M_S, since_ms: int = 0) -> Wheel:
    """Return a wheel that was commanded like this in the last period."""
    wheel = Wheel()
    stalls.command(wheel, speed_m_s, since_ms, DEFAULTS)
    return wheel


def fields(wheel: Wheel) -> dict[str, float]:
    return {name: getattr(wheel, name) for name in Wheel.__slots__}


def test_new_wheel_has_no_command_and_misses_nothing() -> None:
    stall = Stall()
    assert not stall.stuck
    for wheel in (stall.left, stall.right):
        assert fields(wheel) == dict.fromkeys(Wheel.__slots__, 0)
    assert stall.left is not stall.right


# Missing distance.


@each("sign", [1.0, -1.0])
@each(("share", "misses"), [(1.0, 0.0), (0.5, 0.0), (0.49, 0.51), (0.0, 1.0), (-0.5, 1.5)])
def test_wheel_below_half_of_its_command_misses_the_rest(
    sign: float, share: float, misses: float
) -> None:
    wheel = Wheel()
    wheel.missing_m = wheel.doubted_m = 0.25
    stalls.miss(wheel, sign * share * 0.01, sign * 0.01)
    before_m = 0.25 if misses else 0.0
    assert wheel.missing_m == pytest.approx(before_m + sign * misses * 0.01)
    assert wheel.doubted_m == before_m


def test_a_wheel_that_is_not_to_turn_misses_nothing() -> None:
    wheel = Wheel()
    wheel.missing_m = wheel.doubted_m = 0.25
    stalls.miss(wheel, 0.01, 0.0)
    assert (wheel.missing_m, wheel.doubted_m) == (0.0, 0.0)


# Uncertainty.


def doubted(missing_m: float, *, left: bool, odometry: Odometry | None = None) -> Odometry:
    """Return the state after a period in which this distance of a wheel was missing before."""
    odometry = odometry or Odometry()
    odometry.cosine, odometry.sine = cos(0.3), sin(0.3)
    odometry.pxx = odometry.pxy = odometry.pxh = 0.0
    odometry.pyy = odometry.pyh = odometry.phh = 0.0
    stall = Stall()
    wheel = stall.left if left else stall.right
    stalls.command(wheel, COMMAND_M_S, 0, DEFAULTS)
    wheel.missing_m = missing_m - COMMAND_M
    stalls.watch(stall, odometry, 0, DEFAULTS)
    return odometry


@each("left", [True, False])
@each("missing_m", [0.06, -0.06, 0.3])
def test_covariance_includes_all_missing_distance(missing_m: float, left: bool) -> None:
    """Include the distance, half of it in every direction, and the turn about the other wheel."""
    odometry = doubted(missing_m, left=left)
    m2, turn = missing_m * missing_m, (-1.0 if left else 1.0) / TRACK_M
    ahead, aside = 0.5 * cos(0.3), 0.5 * sin(0.3)
    assert odometry.pxx == pytest.approx(m2 * (ahead * ahead + 0.25))
    assert odometry.pyy == pytest.approx(m2 * (aside * aside + 0.25))
    assert odometry.pxy == pytest.approx(m2 * ahead * aside)
    assert odometry.pxh == pytest.approx(m2 * ahead * turn)
    assert odometry.pyh == pytest.approx(m2 * aside * turn)
    assert odometry.phh == pytest.approx(m2 * turn * turn)


@each("left", [True, False])
def test_five_centimetres_are_the_motors_slack(left: bool) -> None:
    assert doubted(0.05, left=left).phh == 0.0
    assert doubted(0.0500001, left=left).phh > 0.0


def test_missing_distance_is_not_included_twice() -> None:
    wheel, odometry = Wheel(), Odometry()
    before = odometry.phh
    for missing_m in (0.1, 0.2, 0.2):
        wheel.missing_m = missing_m
        stalls.doubt(wheel, odometry, 2.0)
        assert wheel.doubted_m == missing_m
        assert odometry.phh - before == pytest.approx(4.0 * missing_m * missing_m)


# Stuck wheels.


@each(("late_ms", "stuck"), [(0, False), (1, True)])
def test_wheel_is_judged_after_a_long_enough_command(late_ms: int, stuck: bool) -> None:
    wheel = commanded(since_ms=1_000)
    now_ms = 1_000 + TIME_MS + late_ms
    assert stalls.is_stuck(wheel, 0.0, now_ms, DEFAULTS) == stuck


@each("sign", [1.0, -1.0])
@each(("share", "stuck"), [(-1.0, True), (0.249, True), (0.25, False)])
def test_wheel_turning_its_share_is_not_stuck(sign: float, share: float, stuck: bool) -> None:
    params = DEFAULTS._replace(wheel_share=0.25, period_s=0.0625)
    wheel = commanded(sign * 0.5)
    wheel.commanded_m, wheel.turned_m = sign * 0.96875, sign * share
    assert stalls.is_stuck(wheel, 0.0, TIME_MS + 1, params) == stuck, "of one metre"


def test_both_sums_go_on_until_the_verdict() -> None:
    wheel = commanded()
    for number in (1, 2, 3):
        assert not stalls.is_stuck(wheel, 0.002, 0, DEFAULTS)
        assert wheel.commanded_m == pytest.approx(number * COMMAND_M)
        assert wheel.turned_m == pytest.approx(number * 0.002)


@each(("turned_m", "stuck"), [(0.0, True), (COMMAND_M, False)])
def test_after_the_verdict_it_is_judged_anew(turned_m: float, stuck: bool) -> None:
    wheel = commanded()
    now_ms = TIME_MS + 1
    assert stalls.is_stuck(wheel, turned_m, now_ms, DEFAULTS) == stuck
    assert (wheel.commanded_m, wheel.turned_m, wheel.commanded_m_s) == (0.0, 0.0, 0.0)
    assert wheel.since_ms == now_ms


def test_a_stuck_wheel_misses_its_coasting_as_well() -> None:
    stuck, turning = commanded(), commanded()
    stalls.is_stuck(stuck, 0.0, TIME_MS + 1, DEFAULTS)
    assert stuck.missing_m == pytest.approx(COMMAND_M + COMMAND_M_S * 0.15)
    stalls.is_stuck(turning, COMMAND_M, TIME_MS + 1, DEFAULTS)
    assert turning.missing_m == 0.0


@each(("left_stands", "right_stands"), [(True, False), (False, True)])
def test_one_stuck_wheel_is_enough(left_stands: bool, right_stands: bool) -> None:
    stall, odometry = Stall(), Odometry()
    for wheel in (stall.left, stall.right):
        stalls.command(wheel, COMMAND_M_S, 0, DEFAULTS)
    odometry.left_m = 0.0 if left_stands else COMMAND_M
    odometry.right_m = 0.0 if right_stands else COMMAND_M
    stalls.watch(stall, odometry, TIME_MS + 1, DEFAULTS)
    assert stall.stuck
    stalls.watch(stall, odometry, TIME_MS + 2, DEFAULTS)
    assert not stall.stuck, "the verdict is that of one period"


# Commands.


@each(
    ("before_m_s", "now_m_s", "afresh", "kept_m_s"),
    [
        (0.2, 0.3, False, 0.3),
        (-0.2, -0.3, False, -0.3),
        (0.2, -0.3, True, -0.3),
        (-0.2, 0.3, True, 0.3),
        (0.0, 0.3, True, 0.3),
        (0.2, DEFAULTS.wheel_min_m_s, True, 0.0),
        (-0.2, -DEFAULTS.wheel_min_m_s, True, 0.0),
        (0.2, DEFAULTS.wheel_min_m_s + 1e-6, False, DEFAULTS.wheel_min_m_s + 1e-6),
        (0.2, 0.0, True, 0.0),
    ],
)
def test_stop_slow_command_or_reversal_restarts(
    before_m_s: float, now_m_s: float, afresh: bool, kept_m_s: float
) -> None:
    wheel = commanded(before_m_s, since_ms=1_000)
    wheel.commanded_m, wheel.turned_m = 0.5, 0.25
    since_ms = wheel.since_ms
    stalls.command(wheel, now_m_s, 2_000, DEFAULTS)
    sums = (wheel.commanded_m, wheel.turned_m, wheel.since_ms)
    assert sums == ((0.0, 0.0, 2_000) if afresh else (0.5, 0.25, since_ms))
    assert wheel.commanded_m_s == kept_m_s


@each(("commanded_m", "stuck"), [(ENOUGH_M + 0.01, True), (0.04, False)])
@each("after_m_s", [0.0, -COMMAND_M_S])
def test_stop_or_reversal_does_not_hide_a_wheel_that_stands(
    after_m_s: float, commanded_m: float, stuck: bool
) -> None:
    wheel = commanded()
    wheel.commanded_m = commanded_m
    stalls.command(wheel, after_m_s, TIME_MS - 100, DEFAULTS)
    assert stalls.is_stuck(wheel, 0.0, TIME_MS - 50, DEFAULTS) == stuck
    assert not stalls.is_stuck(wheel, 0.0, TIME_MS, DEFAULTS)


# Braking before a reversal.


@each("sign", [1.0, -1.0])
def test_wheel_that_slows_down_before_it_reverses_misses_nothing(sign: float) -> None:
    wheel = Wheel()
    wheel.moved_m = sign * 0.015
    for moved_m in (0.013, 0.009, 0.006, 0.002):
        stalls.miss(wheel, sign * moved_m, -sign * COMMAND_M)
        assert wheel.missing_m == 0.0


@each("sign", [1.0, -1.0])
def test_wheel_that_goes_on_the_wrong_way_misses_all_of_it(sign: float) -> None:
    wheel = Wheel()
    wheel.moved_m = sign * 0.01
    for times in (1, 2, 3):
        stalls.miss(wheel, sign * 0.01, -sign * COMMAND_M)
        assert wheel.missing_m == pytest.approx(-sign * times * (COMMAND_M + 0.01))


def is_stuck_after(left_m_s: float, turned: float, seconds: float) -> bool:
    """Return whether the left wheel is stuck if it turns this share of its command."""
    stall, odometry = Stall(), Odometry()
    odometry.left_m = left_m_s * DEFAULTS.period_s * turned
    stuck = False
    for k in range(round(seconds * 20)):
        stalls.watch(stall, odometry, k * PERIOD_MS, DEFAULTS)
        stuck = stuck or stall.stuck
        stalls.command(stall.left, left_m_s, k * PERIOD_MS, DEFAULTS)
    return stuck


def test_a_wheel_that_does_not_turn_is_stuck_after_half_a_second() -> None:
    assert not is_stuck_after(0.2, 0.0, 0.5)
    assert is_stuck_after(0.2, 0.0, 0.7)
    assert is_stuck_after(-0.2, 0.0, 0.7)


def test_a_wheel_that_turns_a_little_is_not_stuck() -> None:
    assert not is_stuck_after(0.2, 0.2, 5.0)
    assert not is_stuck_after(-0.2, 1.0, 5.0)


def test_a_wheel_that_turns_the_wrong_way_is_stuck() -> None:
    assert is_stuck_after(0.2, -1.0, 0.7)


def test_wheel_with_a_slow_command_is_not_judged() -> None:
    assert not is_stuck_after(0.04, 0.0, 5.0)


def test_a_command_to_and_fro_is_never_stuck() -> None:
    stall, odometry = Stall(), Odometry()
    for k in range(100):
        stalls.watch(stall, odometry, k * PERIOD_MS, DEFAULTS)
        assert not stall.stuck
        stalls.command(stall.left, 0.2 if (k // 4) % 2 else -0.2, k * PERIOD_MS, DEFAULTS)


def verdict(poses: "list[Pose]", distances_m: "list[float]", step_ms: int = 1000) -> int:
    progress = ProgressMonitor()
    progresses.restart(progress, poses[0], 0)
    reason: int = reasons.OK
    for k, (pose, distance_m) in enumerate(zip(poses, distances_m, strict=True)):
        reason = progresses.judge(progress, pose, distance_m, k * step_ms, DEFAULTS)
    return reason


def test_no_motion_is_blocked_after_ten_seconds() -> None:
    here = Pose(1.0, 2.0, pi)
    assert verdict([here] * 11, [3.0] * 11) == reasons.OK
    assert verdict([here] * 12, [3.0] * 12) == reasons.BLOCKED


def test_dithering_is_blocked_too() -> None:
    poses = [Pose(1.0 + 0.03 * (k % 2), 2.0, pi - 0.1 * (k % 3)) for k in range(12)]
    assert verdict(poses, [3.0] * 12) == reasons.BLOCKED


def test_turning_on_the_spot_is_getting_somewhere() -> None:
    poses = [Pose(0.0, 0.0, pi - 0.1 * k) for k in range(60)]
    assert verdict(poses, [3.0] * 60) == reasons.OK


def test_no_progress_ends_the_goal_after_two_minutes() -> None:
    poses = [Pose(k % 7 * 1.0, 0.0, 0.0) for k in range(122)]
    assert verdict(poses[:121], [3.0] * 121) == reasons.OK
    assert verdict(poses, [3.0] * 122) == reasons.NO_PROGRESS
    closer = [3.0] * 100 + [2.94] * 22
    assert verdict(poses, closer) == reasons.OK


def test_patient_navigator_ends_when_blocked() -> None:
    progress, here = ProgressMonitor(), Pose(0.0, 0.0, 0.0)
    progresses.restart(progress, here, 0)
    for k in range(200):
        there = Pose(k % 7 * 1.0, 0.0, 0.0)
        assert progresses.judge(progress, there, 3.0, k * 1000, DEFAULTS, True) == reasons.OK
    ends = [progresses.judge(progress, here, 3.0, 1000 * k, DEFAULTS, True) for k in (200, 211)]
    assert ends == [reasons.OK, reasons.BLOCKED]


@each(("squares", "least_s"), [(1, 220), (7, 460)])
def test_patient_navigator_is_lost_where_it_knows_each_place(squares: int, least_s: int) -> None:
    """The longer the way that it knows, the longer may it take to find a place that is new."""
    progress = ProgressMonitor()
    progresses.restart(progress, Pose(0.0, 0.0, 0.0), 0)
    second, reason = 0, reasons.OK
    while reason == reasons.OK:
        second += 1
        there = Pose(second % squares * SQUARE_M - 1.0, 0.0, 0.6 * second % 3.0)
        reason = progresses.judge(progress, there, 3.0, second * 1000, DEFAULTS, True)
    assert reason == reasons.LOST
    assert second == least_s + squares + 1


@each("newer", [Pose(200.0, -90.0, 0.0), Pose(0.0, -3.0, 0.0)])
def test_new_place_and_shorter_distance_give_time(newer: Pose) -> None:
    for place, distance_m in ((newer, 3.0), (Pose(0.0, 0.0, 1.0), 2.0)):
        progress = ProgressMonitor()
        progresses.restart(progress, Pose(0.0, 0.0, 0.0), 0)
        for second in range(1, 400):
            turned = Pose(0.0, 0.0, 0.6 * second % 3.0)
            now = (place, distance_m) if second == 200 else (turned, 3.0)
            assert progresses.judge(progress, *now, second * 1000, DEFAULTS, True) == reasons.OK


def variances_after(left_turned: float, seconds: float, speed_m_s: float = 0.2) -> Odometry:
    """Return the uncertainty of the pose if the left wheel turns this share of its command."""
    stall, odometry = Stall(), Odometry()
    for k in range(round(seconds * 20)):
        odometry.left_m = speed_m_s * DEFAULTS.period_s * left_turned if k else 0.0
        odometry.right_m = speed_m_s * DEFAULTS.period_s if k else 0.0
        stalls.watch(stall, odometry, k * PERIOD_MS, DEFAULTS)
        for wheel in (stall.left, stall.right):
            stalls.command(wheel, speed_m_s, k * PERIOD_MS, DEFAULTS)
    return odometry


def test_covariance_includes_motion_of_a_stopped_wheel() -> None:
    odometry = variances_after(0.0, 0.45)  # eight periods were commanded: 80 mm
    missing_m = 0.08
    assert odometry.phh**0.5 == pytest.approx(missing_m / DEFAULTS.track_m)
    assert odometry.pxx == pytest.approx(0.5 * missing_m * missing_m)


def test_slow_start_does_not_extend_the_covariance() -> None:
    assert variances_after(1.0, 5.0).phh == 0.0
    assert variances_after(0.6, 5.0).phh == 0.0
    assert variances_after(0.0, 0.15).phh == 0.0


def test_a_stuck_wheel_widens_both_ways_of_turning_alike() -> None:
    assert variances_after(0.0, 0.6, 0.2).phh == pytest.approx(variances_after(0.0, 0.6, -0.2).phh)
