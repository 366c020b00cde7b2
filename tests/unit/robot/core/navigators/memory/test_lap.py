from math import cos, pi, sin

from hypothesis import given
from hypothesis import strategies as st

from robot.core.navigators import classical as laps
from robot.core.navigators.classical import Lap
from robot.core.values import Pose, wrap

STEP_M = 0.015


def begun(pose: Pose) -> Lap:
    lap = Lap()
    laps.begin(lap, pose)
    return lap


def on_circle(radius_m: float, angle_rad: float) -> Pose:
    """Return a pose on a counter-clockwise circle about the origin."""
    x_m, y_m = radius_m * cos(angle_rad), radius_m * sin(angle_rad)
    return Pose(x_m, y_m, wrap(angle_rad + 0.5 * pi))


def closings(poses: list[Pose]) -> list[int]:
    """Return the ticks at which a lap was closed."""
    lap = begun(poses[0])
    return [k for k, pose in enumerate(poses) if laps.closes_lap(lap, pose)]


def circle(radius_m: float, turns: float) -> list[Pose]:
    ticks = round(turns * 2.0 * pi * radius_m / STEP_M)
    return [on_circle(radius_m, k * STEP_M / radius_m) for k in range(ticks)]


@given(st.floats(0.17, 5.0), st.booleans())
def test_every_lap_is_detected_once(radius_m: float, mirrored: bool) -> None:
    poses = circle(radius_m, 3.6)
    if mirrored:
        poses = [Pose(x_m, -y_m, -heading_rad) for x_m, y_m, heading_rad in poses]
    assert 3 <= len(closings(poses)) <= 4
    assert not closings(poses[: len(poses) // 5])


def test_return_through_a_corridor_is_no_lap() -> None:
    there = [Pose(k * STEP_M, 0.0, 0.0) for k in range(200)]
    turn = [Pose(3.0, 0.2 * k / 30, pi * k / 30) for k in range(31)]
    back = [Pose(3.0 - k * STEP_M, 0.2, pi) for k in range(200)]
    assert not closings(there + turn + back)


def test_same_pose_without_a_full_turn_is_no_lap() -> None:
    there = [Pose(k * STEP_M, 0.0, 0.0) for k in range(100)]
    left = [Pose(1.5, 0.0, pi * k / 30) for k in range(31)]
    back = [Pose(1.5 - k * STEP_M, 0.0, pi) for k in range(100)]
    right = [Pose(0.0, 0.0, pi - pi * k / 30) for k in range(31)]
    assert not closings(there + left + back + right + there)


def test_a_robot_that_can_only_spin_is_boxed_in() -> None:
    spun = [Pose(1.0, 1.0, wrap(0.1 * k)) for k in range(200)]
    assert closings(spun)
    assert not closings(spun[:120])


def test_turns_off_the_boundary_count_but_distance_does_not() -> None:
    lap = begun(Pose(0.0, 0.0, 0.0))
    laps.resume(lap, Pose(5.0, 0.0, 1.0))
    assert not laps.closes_lap(lap, Pose(5.01, 0.0, 1.5))
    assert abs(lap.turned_rad - 1.5) < 1e-9
    assert abs(lap.at_m - 0.01) < 1e-9


def test_a_mark_on_another_boundary_is_replaced() -> None:
    elsewhere = [Pose(k * STEP_M, 0.0, 0.0) for k in range(100)]
    poses = elsewhere + [Pose(x_m + 9.0, y_m, h_rad) for x_m, y_m, h_rad in circle(0.5, 4.5)]
    assert len(closings(poses)) >= 2
