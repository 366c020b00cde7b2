from math import exp

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.model.configuration import LEVELS, Body, Fault, Noise
from plant.sim.active_faults import NO_TROUBLE, ActiveFaults, FaultSchedule
from plant.sim.drive import DifferentialDrive, Motor
from tests.support.each import each

MS = 1_000_000
SUBSTEP_S = 0.025
QUICK = Body(max_acceleration_m_s2=1e6, motor_lag_s=0.0)
speeds = st.floats(-0.3, 0.3)


def mrad_s(rim_m_s: float) -> int:
    return round(rim_m_s / 0.033 * 1000.0)


def run(
    drive: DifferentialDrive,
    left_m_s: float,
    right_m_s: float,
    steps: int,
    trouble: ActiveFaults = NO_TROUBLE,
) -> tuple[float, float]:
    """Return the poses of a drive with a new command in each step."""
    left_m = right_m = 0.0
    for _ in range(steps):
        drive.command(mrad_s(left_m_s), mrad_s(right_m_s), 150, 0)
        left, right = drive.roll(0, SUBSTEP_S, trouble)
        left_m, right_m = left_m + left, right_m + right
    return left_m, right_m


def test_small_speed_change_lags_exponentially() -> None:
    motor = Motor(Body(motor_lag_s=0.05))
    motor.turn(0.05, 0.03)
    assert motor.speed_m_s == pytest.approx(0.05 * (1.0 - exp(-0.6)), abs=1e-12)


def test_large_speed_change_is_limited_by_acceleration() -> None:
    motor = Motor(Body())
    way_m = motor.turn(0.3, 0.1)
    assert motor.speed_m_s == pytest.approx(0.15, abs=1e-12)
    assert way_m == pytest.approx(0.5 * 1.5 * 0.1**2, abs=1e-12)


@given(speeds, speeds, st.integers(1, 40), st.floats(0.0, 0.2))
def test_motor_result_does_not_depend_on_the_step_size(
    start_m_s: float, wanted_m_s: float, parts: int, lag_s: float
) -> None:
    whole, cut = Motor(Body(motor_lag_s=lag_s)), Motor(Body(motor_lag_s=lag_s))
    whole.speed_m_s = cut.speed_m_s = start_m_s
    whole_m = whole.turn(wanted_m_s, 0.4)
    cut_m = sum(cut.turn(wanted_m_s, 0.4 / parts) for _ in range(parts))
    assert cut.speed_m_s == pytest.approx(whole.speed_m_s, abs=1e-9)
    assert cut_m == pytest.approx(whole_m, abs=1e-9)


@given(speeds, speeds, st.floats(1e-3, 1.0), st.floats(0.0, 0.5))
def test_motor_limits_acceleration_and_never_overshoots(
    start_m_s: float, wanted_m_s: float, span_s: float, lag_s: float
) -> None:
    motor = Motor(Body(motor_lag_s=lag_s))
    motor.speed_m_s = start_m_s
    way_m = motor.turn(wanted_m_s, span_s)
    slowest, fastest = sorted((start_m_s, wanted_m_s))
    assert abs(motor.speed_m_s - start_m_s) <= 1.5 * span_s + 1e-9
    assert slowest - 1e-9 <= motor.speed_m_s <= fastest + 1e-9
    assert slowest * span_s - 1e-9 <= way_m <= fastest * span_s + 1e-9


@given(speeds, st.floats(1e-4, 1.0))
def test_braked_motor_stops_and_does_not_reverse(start_m_s: float, span_s: float) -> None:
    motor = Motor(Body())
    motor.speed_m_s = start_m_s
    way_m = motor.brake(8.0, span_s)
    assert abs(motor.speed_m_s) == pytest.approx(max(0.0, abs(start_m_s) - 8.0 * span_s), abs=1e-9)
    assert motor.speed_m_s * start_m_s >= 0.0
    assert abs(way_m) <= abs(start_m_s) ** 2 / 16.0 + 1e-9


@given(st.integers(), st.integers())
def test_no_command_exceeds_the_maximum_wheel_speed(left_mrad_s: int, right_mrad_s: int) -> None:
    drive = DifferentialDrive(QUICK, LEVELS["none"], 1, 0)
    drive.command(left_mrad_s, right_mrad_s, 150, 0)
    ways_m = drive.roll(0, SUBSTEP_S, NO_TROUBLE)
    assert max(abs(way_m) for way_m in ways_m) <= 0.3 * SUBSTEP_S + 1e-12


def test_wheels_brake_when_the_command_expires() -> None:
    drive = DifferentialDrive(Body(), LEVELS["none"], 1, 0)
    run(drive, 0.3, 0.3, 40)
    drive.command(mrad_s(0.3), mrad_s(0.3), 150, 0)
    for now_ms in range(0, 150, 25):
        assert drive.roll(now_ms * MS, SUBSTEP_S, NO_TROUBLE)[0] > 0.0074
        assert not drive.expired
    drive.roll(150 * MS, SUBSTEP_S, NO_TROUBLE)
    assert drive.expired
    drive.roll(175 * MS, SUBSTEP_S, NO_TROUBLE)
    assert drive.roll(200 * MS, SUBSTEP_S, NO_TROUBLE) == (0.0, 0.0)


def test_new_command_ends_the_expiry() -> None:
    drive = DifferentialDrive(Body(), LEVELS["none"], 1, 0)
    drive.command(1000, 1000, 25, 0)
    drive.roll(25 * MS, SUBSTEP_S, NO_TROUBLE)
    assert drive.expired
    drive.command(1000, 1000, 150, 50 * MS)
    drive.roll(50 * MS, SUBSTEP_S, NO_TROUBLE)
    assert not drive.expired


def test_no_command_has_expired_before_the_first() -> None:
    drive = DifferentialDrive(Body(), LEVELS["none"], 1, 0)
    assert drive.roll(10**12, SUBSTEP_S, NO_TROUBLE) == (0.0, 0.0)
    assert not drive.expired


def test_encoder_counts_whole_ticks_of_0_2_mm() -> None:
    drive = DifferentialDrive(QUICK, LEVELS["none"], 1, 0)
    left_m, right_m = run(drive, 0.1, -0.1, 40)
    assert left_m == pytest.approx(0.1, rel=2e-4)
    assert drive.ticks() == (int(left_m * 5000.0), -int(-right_m * 5000.0) - 1)


@each(("start", "rim_m_s"), [(2**31 - 100, 0.1), (-(2**31) + 100, -0.1)])
def test_encoder_counter_wraps_at_32_bits(start: int, rim_m_s: float) -> None:
    drive = DifferentialDrive(
        Body(max_acceleration_m_s2=1e6, motor_lag_s=0.0, left_start_ticks=start),
        LEVELS["none"],
        1,
        0,
    )
    run(drive, rim_m_s, rim_m_s, 40)
    left, right = drive.ticks()
    assert left * start < 0
    assert (left - start + 2**31) % 2**32 - 2**31 == pytest.approx(right, abs=1)


def test_unequal_wheels_roll_different_distances_per_turn() -> None:
    drive = DifferentialDrive(QUICK, Noise(diameter_difference_ratio=0.005), 1, 0)
    left_m, right_m = run(drive, 0.2, 0.2, 40)
    assert drive.ticks()[0] == drive.ticks()[1]
    assert right_m / left_m - 1.0 == pytest.approx(0.005, rel=0.01)


def test_slip_variance_grows_with_wheel_distance() -> None:
    drive = DifferentialDrive(QUICK, Noise(slip_variance_m=2e-6), 7, 0)
    rows = 20_000
    errors = np.empty((rows, 2))
    for row in range(rows):
        left_m, right_m = run(drive, 0.2, -0.1, 1)
        errors[row] = left_m - 0.2 * SUBSTEP_S, right_m + 0.1 * SUBSTEP_S
    per_metre = errors.var(axis=0) / (0.2 * SUBSTEP_S, 0.1 * SUBSTEP_S)
    assert per_metre == pytest.approx(2e-6, rel=0.05)
    assert abs((errors[:, 0] * errors[:, 1]).mean()) < 0.03 * errors.std() ** 2
    assert abs(errors.mean()) < 5e-6


def test_wheel_at_rest_does_not_slip() -> None:
    drive = DifferentialDrive(QUICK, LEVELS["harsh"], 1, 0)
    assert run(drive, 0.0, 0.0, 10) == (0.0, 0.0)


def test_slipping_wheel_counts_more_than_it_rolls() -> None:
    drive = DifferentialDrive(QUICK, LEVELS["none"], 1, 0)
    trouble = FaultSchedule([Fault("wheel_slip", "right", value=0.3)]).at(0)
    left_m, right_m = run(drive, 0.2, 0.2, 40, trouble)
    assert right_m == pytest.approx(0.7 * left_m)
    assert drive.ticks()[0] == drive.ticks()[1]


def test_stuck_wheel_neither_rolls_nor_counts() -> None:
    drive = DifferentialDrive(QUICK, LEVELS["none"], 1, 0)
    left_m, right_m = run(drive, 0.2, 0.2, 4, FaultSchedule([Fault("wheel_stuck", "left")]).at(0))
    assert (left_m, drive.ticks()[0]) == (0.0, 0)
    assert (right_m > 0.0, drive.ticks()[1] > 0) == (True, True)


def test_stuck_encoder_misses_the_distance_rolled_meanwhile() -> None:
    drive = DifferentialDrive(QUICK, LEVELS["none"], 1, 0)
    run(drive, 0.2, 0.2, 4)
    before = drive.ticks()
    left_m, _ = run(drive, 0.2, 0.2, 4, FaultSchedule([Fault("encoder_stuck", "left")]).at(0))
    assert left_m == pytest.approx(0.02, rel=2e-4)
    assert drive.ticks() == (before[0], 2 * before[1])
    run(drive, 0.2, 0.2, 4)
    assert drive.ticks() == (2 * before[0], 3 * before[1])
