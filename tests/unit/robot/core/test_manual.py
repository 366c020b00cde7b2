"""MANUAL: the operator steers within limits and guard; without an operator the robot stops."""

from math import inf, nan

from hypothesis import given
from hypothesis import strategies as st

from robot.core import modes, reasons, states
from robot.core.parameters import DEFAULTS
from robot.core.values import Scan, Twist
from tests.support.each import each
from tests.support.robot.core.driving import Driven, armed

WALL_AHEAD = Scan((100,) * 8, (25, 0) * 4, 0xFF, 0xFF)


def manual() -> Driven:
    driven = armed()
    assert modes.set_mode(driven.machine, driven.state.trail, states.MANUAL, 0) == reasons.OK
    return driven


def test_robot_follows_the_operator_within_its_acceleration() -> None:
    driven = manual()
    driven.state.manual = Twist(0.2, 0.0)
    first = driven.tick().twist.speed_m_s
    assert 0.0 < first <= DEFAULTS.accel_m_s2 * DEFAULTS.period_s + 1e-12
    driven.forward(0.5)
    assert driven.outputs.twist == Twist(0.2, 0.0)
    driven.state.manual = Twist(-0.1, 0.0)
    driven.forward(0.5)
    assert driven.outputs.twist == Twist(-0.1, 0.0)
    driven.state.manual = Twist(0.0, 1.0)
    driven.forward(0.5)
    assert driven.outputs.twist == Twist(0.0, 1.0)


def test_without_teleop_the_wheels_stop_in_that_tick() -> None:
    driven = manual()
    driven.state.manual = Twist(0.3, 0.5)
    driven.forward(1.0)
    driven.state.manual = None
    driven.tick()
    assert driven.stands


def test_teleop_needs_manual_mode_and_arming() -> None:
    driven = armed()
    driven.state.manual = Twist(0.2, 0.0)
    assert driven.forward(0.5).stands, "in HOLD"
    driven = manual()
    driven.state.manual = Twist(0.2, 0.0)
    modes.disarm(driven.machine, 0)
    assert driven.forward(0.5).stands


def test_guard_stops_teleop_before_a_wall() -> None:
    driven = manual()
    driven.scan = WALL_AHEAD
    driven.state.manual = Twist(0.3, 0.0)
    driven.forward(0.2)
    assert driven.outputs.guard == reasons.SLOWED
    driven.scan = WALL_AHEAD._replace(range_mm=(40,) * 8)
    driven.forward(0.1)
    assert driven.outputs.guard == reasons.OBSTACLE_AHEAD
    assert driven.stands


@given(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0))
def test_whatever_is_wanted_wheels_and_robot_keep_their_limits(
    speed_m_s: float, yaw_rate_rad_s: float
) -> None:
    driven = manual()
    driven.state.manual = Twist(speed_m_s, yaw_rate_rad_s)
    for _ in range(20):
        twist = driven.tick().twist
        assert abs(twist.speed_m_s) <= DEFAULTS.v_max_m_s + 1e-9
        assert abs(twist.yaw_rate_rad_s) <= DEFAULTS.yaw_max_rad_s + 1e-9


@each("twist", [Twist(nan, 0.0), Twist(0.0, nan), Twist(0.0, inf)])
def test_teleop_with_nan_turns_no_wheel(twist: Twist) -> None:
    driven = manual()
    driven.state.manual = twist
    driven.tick()
    assert driven.stands
