from math import inf, isfinite, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core import reasons
from robot.core.parameters import DEFAULTS, Params
from robot.core.perception import sonar_ring as rings
from robot.core.perception.sonar_ring import FRONT, Ring
from robot.core.safety import guard
from robot.core.values import COSINES, Scan, Wheels
from tests.support.each import each

REST = Wheels(0, 0, 0, 0)
anything = st.floats()  # NaN and infinity included
ranges_mm = st.lists(st.one_of(st.none(), st.integers(1, 3000)), min_size=8, max_size=8)


def ring(echoes: "dict[int, int] | None" = None, valid: int = 0xFF) -> Ring:
    echoes = echoes or {}
    seen = Ring()
    ranges = tuple(echoes.get(i, 0) for i in range(8))
    rings.update(seen, Scan(ranges, (0,) * 8, valid, sum(1 << i for i in echoes)), 0, DEFAULTS)
    return seen


def limit(
    speed: float, yaw: float, seen: Ring, wheels: Wheels | None = REST, params: Params = DEFAULTS
) -> tuple[float, int]:
    return guard.limit(speed, yaw, seen, wheels, params)


@given(anything, anything, ranges_mm, st.integers(0, 255), st.integers(0, 7))
def test_the_guard_never_adds_speed_and_never_steers(
    speed: float, yaw: float, ranges: list[int | None], valid: int, bumper: int
) -> None:
    seen = ring({i: mm for i, mm in enumerate(ranges) if mm is not None}, valid)
    factor, reason = limit(speed, yaw, seen, Wheels(0, 0, bumper, 0))
    assert 0.0 <= factor <= 1.0
    assert (factor == 1.0) == (reason == reasons.OK)
    if factor > 0.0:
        assert isfinite(speed)
        assert isfinite(yaw)
        rim = abs(speed) + 0.5 * DEFAULTS.track_m * abs(yaw)
        assert rim * factor <= DEFAULTS.wheel_max_m_s * (1 + 2e-9)


@given(st.floats(0.01, 0.3), ranges_mm)
def test_guard_limits_the_approach_to_an_echo_ahead(speed: float, ranges: list[int | None]) -> None:
    seen = ring({i: mm for i, mm in enumerate(ranges) if mm is not None})
    factor, _ = limit(speed, 0.0, seen)
    room_m = max(seen.front_m - DEFAULTS.guard_stop_m, 0.0)
    closing_m_s = factor * speed * COSINES[2]
    assert closing_m_s <= room_m / DEFAULTS.guard_time_s + 1e-9


@each(("speed", "yaw"), [(nan, 0.0), (0.0, nan), (inf, 0.0), (0.1, -inf)])
def test_command_with_nan_or_infinity_stops(speed: float, yaw: float) -> None:
    assert limit(speed, yaw, ring()) == (0.0, reasons.NOT_FINITE)


def test_without_senses_nothing_moves() -> None:
    assert limit(0.1, 0.0, ring(), wheels=None) == (0.0, reasons.NO_SENSES)
    assert limit(0.0, 1.0, Ring()) == (0.0, reasons.NO_SENSES)


def test_without_range_ahead_only_turning_is_possible() -> None:
    blind = ring(valid=0xFF & ~0b0001_1000)
    assert limit(0.1, 0.0, blind) == (0.0, reasons.OBSTACLE_AHEAD)
    assert limit(0.0, 1.0, blind) == (1.0, reasons.OK)


@each("dead", range(8))
def test_one_dead_sonar_does_not_stop_the_robot(dead: int) -> None:
    assert limit(0.1, 0.0, ring(valid=0xFF & ~(1 << dead))) == (1.0, reasons.OK)


def test_zero_command_has_no_reason() -> None:
    assert limit(0.0, 0.0, Ring(), wheels=None) == (1.0, reasons.OK)


def test_too_fast_wheels_are_scaled_together() -> None:
    factor, reason = limit(0.3, 1.5, ring())
    assert factor == pytest.approx(0.3 / 0.45)
    assert reason == reasons.WHEEL_LIMIT


def test_a_command_at_the_wheel_limit_passes_up_to_rounding() -> None:
    most_m_s = DEFAULTS.wheel_max_m_s
    assert limit(most_m_s * (1 + 1e-9), 0.0, ring()) == (1.0, reasons.OK)
    assert limit(most_m_s * (1 + 1e-8), 0.0, ring())[1] == reasons.WHEEL_LIMIT
    assert limit(most_m_s * 1.005, 0.0, ring())[0] == pytest.approx(1 / 1.005)


@each("i", FRONT)
def test_echo_ahead_permits_the_maximum_approach_speed(i: int) -> None:
    factor, reason = limit(0.3, 0.0, ring({i: 60}))
    closing_m_s = factor * 0.3 * COSINES[i]
    assert closing_m_s == pytest.approx((0.06 - DEFAULTS.guard_stop_m) / DEFAULTS.guard_time_s)
    assert reason == reasons.SLOWED


def test_room_never_lets_a_command_grow() -> None:
    assert guard.forward_factor(0.01, ring({3: 3000}), DEFAULTS) == 1.0
    assert guard.forward_factor(0.01, ring(), DEFAULTS._replace(guard_stop_m=0.0)) == 1.0


def test_speed_falls_with_the_room_ahead_down_to_a_stop() -> None:
    free = limit(0.3, 0.0, ring({3: 400}))
    near = limit(0.3, 0.0, ring({3: 100}))
    nearer = limit(0.3, 0.0, ring({3: 60, 4: 100}))
    stop = limit(0.3, 0.0, ring({4: 40}))
    assert free == (1.0, reasons.OK)
    assert 1.0 > near[0] > nearer[0] > 0.0
    assert near[1] == nearer[1] == reasons.SLOWED
    assert stop == (0.0, reasons.OBSTACLE_AHEAD)


def test_an_echo_beside_the_robot_is_not_in_its_way() -> None:
    assert limit(0.3, 0.0, ring({0: 30, 7: 30})) == (1.0, reasons.OK)


def test_pedestrian_at_a_flank_does_not_stop_the_robot() -> None:
    for i in (0, 1, 6, 7):
        near = ring({i: 60})
        near.approach_m_s[i] = 0.1
        assert limit(0.3, 0.0, near) == (1.0, reasons.OK)


def test_pedestrian_ahead_reduces_the_speed() -> None:
    seen = ring({3: 120})
    standing, _ = limit(0.3, 0.0, seen)
    seen.approach_m_s[3] = 0.1
    walking, _ = limit(0.3, 0.0, seen)
    assert 0.0 < walking < standing
    seen.approach_m_s[3] = 0.2
    assert limit(0.3, 0.0, seen) == (0.0, reasons.OBSTACLE_AHEAD)


def test_the_obstacle_part_can_be_switched_off() -> None:
    off = DEFAULTS._replace(guard_stop_m=0.0)
    assert limit(0.3, 0.0, ring({3: 20}), params=off) == (1.0, reasons.OK)


def test_obstacle_ahead_permits_turning_and_reversing() -> None:
    wall = ring(dict.fromkeys(range(8), 30))
    assert limit(0.0, 2.0, wall) == (1.0, reasons.OK)
    assert limit(-0.1, 0.0, wall) == (1.0, reasons.OK)


def test_a_pressed_bumper_forbids_pressing_on() -> None:
    for sector in (1, 2, 3):
        assert limit(0.1, 0.0, ring(), Wheels(0, 0, sector, 0)) == (0.0, reasons.BUMPER)
        assert limit(-0.1, 0.0, ring(), Wheels(0, 0, sector, 0)) == (1.0, reasons.OK)
    assert limit(-0.1, 0.0, ring(), Wheels(0, 0, 4, 0)) == (0.0, reasons.BUMPER)
    assert limit(0.1, 0.0, ring(), Wheels(0, 0, 4, 0)) == (1.0, reasons.OK)


@each("sector", [1, 2, 4])
def test_a_pressed_bumper_allows_a_turn_on_the_spot(sector: int) -> None:
    assert limit(0.0, 1.0, ring(), Wheels(0, 0, sector, 0)) == (1.0, reasons.OK)
