"""Conversion of messages to inputs of the core, used by host and trial."""

from math import pi
from typing import NamedTuple

from hypothesis import given
from hypothesis import strategies as st

from robot.core.values import Scan, Wheels, goal_of, now_ms_of, scan_of, wheels_of


class TicksLike(NamedTuple):
    time_ns: int
    left: int
    right: int
    bumper: int


class ScanLike(NamedTuple):
    range_mm: tuple[int, ...]
    ping_age_us: tuple[int, ...]
    valid: int
    echo: int


GROUPS_US = (25_000, 0) * 4
mm = st.integers(-(2**31), 2**31 - 1)


def test_stamp_is_truncated_to_milliseconds() -> None:
    assert [now_ms_of(ns) for ns in (0, 999_999, 1_000_000, 50_000_000)] == [0, 0, 1, 50]


def test_wheels_pass_unchanged_whichever_way_they_turned() -> None:
    ticks = TicksLike(150_900_000, -(2**31), 2**31 - 1, 5)
    assert wheels_of(ticks) == Wheels(-(2**31), 2**31 - 1, 5, 150)


def test_the_two_ping_groups_keep_their_ages() -> None:
    ranges_mm = (20, 300, 3000, 0, 65535, 1, 2, 3)
    scan = scan_of(ScanLike(ranges_mm, GROUPS_US, 0b1110_1111, 0b0000_1111), 0)
    assert scan == Scan(ranges_mm, (25, 0) * 4, 0b1110_1111, 0b0000_1111)


def test_a_scan_that_is_used_again_has_older_pings() -> None:
    scan = scan_of(ScanLike((1,) * 8, GROUPS_US, 255, 255), 100)
    assert scan.age_ms == (125, 100) * 4


def test_a_goal_arrives_in_metres_and_radians() -> None:
    goal = goal_of(5400, -20, round(pi * 1e6), 0, 50, 52_360)
    assert (goal.x_m, goal.y_m, goal.position_tolerance_m) == (5.4, -0.02, 0.05)
    assert goal.heading_rad is not None
    assert abs(goal.heading_rad - pi) < 1e-6
    assert goal.heading_tolerance_rad == 0.05236


def test_a_free_heading_is_none_and_not_zero() -> None:
    assert goal_of(0, 0, 0, 1, 50, 52_360).heading_rad is None
    assert goal_of(0, 0, 0, 0, 50, 52_360).heading_rad == 0.0


@given(mm, mm, st.integers(-3_141_593, 3_141_593), st.integers(0, 65535))
def test_what_the_wire_carries_comes_back_exactly(x: int, y: int, urad: int, tol: int) -> None:
    goal = goal_of(x, y, urad, 0, tol, 1)
    assert goal.heading_rad is not None
    assert round(goal.x_m * 1000) == x
    assert round(goal.y_m * 1000) == y
    assert round(goal.heading_rad * 1e6) == urad
    assert round(goal.position_tolerance_m * 1000) == tol
