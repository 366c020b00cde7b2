from math import cos, inf, pi, sin

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from robot.core import motion
from robot.core.motion import into, limited, ramp, toward
from robot.core.parameters import DEFAULTS
from robot.core.values import Twist
from tests.support.each import each

distances = st.floats(0.001, 20.0)
bearings = st.floats(-pi, pi)
twists = st.tuples(st.floats(-0.3, 0.3), st.floats(-2.5, 2.5)).map(
    lambda pair: Twist(*limited(*pair, DEFAULTS))
)


def rim_m_s(speed: float, yaw: float) -> float:
    return abs(speed) + 0.5 * DEFAULTS.track_m * abs(yaw)


@given(distances, bearings)
def test_lyapunov_function_of_position_controller_never_grows(rho: float, alpha: float) -> None:
    speed, yaw = toward(rho, alpha, DEFAULTS)
    rho_dot, alpha_dot = -speed * cos(alpha), -yaw + speed * sin(alpha) / rho
    assert rho * rho_dot + alpha * alpha_dot <= 1e-9
    assert speed >= 0.0


@given(distances, st.floats(-1.5, 1.5), bearings)
def test_lyapunov_function_of_pose_controller_never_grows(
    rho: float, alpha: float, theta: float
) -> None:
    speed, yaw = into(rho, alpha, theta, DEFAULTS)
    sight_dot = speed * sin(alpha) / rho
    rho_dot, alpha_dot = -speed * cos(alpha), -yaw + sight_dot
    v_dot = rho * rho_dot + alpha * alpha_dot + DEFAULTS.pose_h * theta * sight_dot
    assert v_dot <= 1e-9


@given(distances, st.floats(pi / 2, pi))
def test_with_the_goal_behind_it_turns_on_the_spot(rho: float, alpha: float) -> None:
    for side in (alpha, -alpha):
        for speed, yaw in (toward(rho, side, DEFAULTS), into(rho, side, 1.0, DEFAULTS)):
            assert speed == 0.0
            assert yaw * side > 0.0


def test_at_the_goal_nothing_is_divided_by_zero() -> None:
    assert toward(0.0, 0.0, DEFAULTS)[0] == pytest.approx(0.0, abs=1e-5)
    assert into(0.0, 0.0, 0.0, DEFAULTS)[1] == 0.0


@given(st.floats(-5, 5), st.floats(-50, 50))
def test_limits_hold_and_the_curvature_stays(speed: float, yaw: float) -> None:
    slower, gentler = limited(speed, yaw, DEFAULTS)
    assert rim_m_s(slower, gentler) <= DEFAULTS.wheel_max_m_s + 1e-9
    assert abs(gentler) <= DEFAULTS.yaw_max_rad_s + 1e-9
    assert slower * yaw == pytest.approx(gentler * speed, abs=1e-9)


@given(twists, twists)
@example(Twist(-0.25, 0.0), Twist(0.015625, 2.5 - 0.15625))  # turns fast and is to reverse
def test_no_wheel_accelerates_faster_than_it_can(wanted: Twist, last: Twist) -> None:
    now = ramp(wanted, last, DEFAULTS)
    change = rim_m_s(now.speed_m_s - last.speed_m_s, now.yaw_rate_rad_s - last.yaw_rate_rad_s)
    assert change <= DEFAULTS.accel_m_s2 * DEFAULTS.period_s + 1e-9
    assert rim_m_s(*now) <= DEFAULTS.wheel_max_m_s + 1e-9


@given(st.floats(0.0, 0.3), st.floats(-2.5, 2.5), st.floats(-2.5, 2.5))
def test_a_stop_comes_before_a_turn(speed_m_s: float, yaw_rad_s: float, now_rad_s: float) -> None:
    can_m_s = DEFAULTS.accel_m_s2 * DEFAULTS.period_s
    now = ramp(Twist(0.0, yaw_rad_s), Twist(speed_m_s, now_rad_s), DEFAULTS)
    assert now.speed_m_s == pytest.approx(max(speed_m_s - can_m_s, 0.0), abs=1e-9)


@each(("wanted_m_s", "turns"), [(-0.2, False), (0.0, False), (0.01, True), (0.29, True)])
def test_only_a_stop_or_a_reversal_delays_a_turn(wanted_m_s: float, turns: bool) -> None:
    """A robot that slows down in order to turn turns at once."""
    now = ramp(Twist(wanted_m_s, 2.0), Twist(0.3, 0.0), DEFAULTS)
    assert (now.yaw_rate_rad_s > 0.0) is turns
    assert now.speed_m_s < 0.3


@given(twists, twists)
def test_the_ramp_arrives(wanted: Twist, last: Twist) -> None:
    for _ in range(12):
        last = ramp(wanted, last, DEFAULTS)
    assert last == wanted


@given(st.floats(-pi, pi))
def test_the_last_turn_ends_without_passing_the_end(error: float) -> None:
    for _ in range(400):
        yaw = motion.align(error, DEFAULTS)
        assert abs(yaw) <= DEFAULTS.yaw_max_rad_s
        after = error - yaw * DEFAULTS.period_s
        assert abs(after) <= abs(error)
        assert after * error >= 0.0
        error = after
    assert abs(error) < 1e-3


def test_the_last_turn_is_slow_but_not_too_slow() -> None:
    assert motion.align(0.05, DEFAULTS) == DEFAULTS.align_min_rad_s
    assert motion.align(-0.4, DEFAULTS) == pytest.approx(-1.0)


def test_infinite_input_gives_no_finite_looking_command() -> None:
    assert toward(inf, 0.0, DEFAULTS)[0] == pytest.approx(DEFAULTS.v_max_m_s)
