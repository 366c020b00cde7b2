from math import pi

import pytest

from robot.core import motion as progresses
from robot.core import reasons
from robot.core.motion import ProgressMonitor
from robot.core.parameters import DEFAULTS
from robot.core.perception import stall as stalls
from robot.core.perception.odometry import Odometry
from robot.core.perception.stall import Stall
from robot.core.values import Pose

PERIOD_MS = 50


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


def test_patient_navigator_ends_only_when_blocked() -> None:
    progress, here = ProgressMonitor(), Pose(0.0, 0.0, 0.0)
    progresses.restart(progress, here, 0)
    for k in range(600):
        there = Pose(k % 7 * 1.0, 0.0, 0.0)
        assert progresses.judge(progress, there, 3.0, k * 1000, DEFAULTS, True) == reasons.OK
    ends = [progresses.judge(progress, here, 3.0, 1000 * k, DEFAULTS, True) for k in (600, 611)]
    assert ends == [reasons.OK, reasons.BLOCKED]


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
