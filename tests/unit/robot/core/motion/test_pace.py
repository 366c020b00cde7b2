from math import inf, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core.navigators import pace
from robot.core.navigators.open_headings import FREE_MM
from robot.core.navigators.pace import (
    BESIDE,
    CLOSE_M,
    DITHER_M,
    DITHER_RAD,
    DITHER_TURNS,
    FLANK_M,
    HOLD_M,
    LOOK_M,
    RISE_M,
    WEAVE_FROM_M,
    WEAVE_M,
    WEAVE_RAD,
    Held,
)
from robot.core.parameters import DEFAULTS
from robot.core.perception.echoes import FADE_TURNS
from robot.core.perception.sonar_ring import SATURATED_M, Ring
from robot.core.values import BEARINGS, SONARS
from tests.support.each import each
from tests.support.robot.core.rings import SILENT, Ranges, heard

AHEAD = [2, 3, 4, 5]
MOST_M_S = DEFAULTS.v_max_m_s


def only(sonar: int, range_m: float) -> Ring:
    ranges: Ranges = [inf] * SONARS
    ranges[sonar] = range_m
    return heard(ranges)


def held(*rings: Ring) -> Held:
    ranges = Held()
    for one in rings:
        pace.hold(ranges, one)
    return ranges


def speed(seen: Ring, free_mm: int = FREE_MM, error_rad: float = 0.0) -> float:
    return pace.speed(held(seen), free_mm, error_rad, DEFAULTS)


def keep_off(seen: Ring) -> float:
    return pace.keep_off(held(seen))


some_range = st.one_of(st.none(), st.just(inf), st.floats(0.02, 3.3), st.floats(0.02, 0.3))
rings = st.lists(some_range, min_size=SONARS, max_size=SONARS).map(heard)
rooms = st.integers(0, FREE_MM)
errors = st.floats(-pi, pi)


def mirrored(seen: Ring) -> Ring:
    return heard(seen.range_m[::-1])


def test_without_near_echoes_the_speed_is_full() -> None:
    assert speed(SILENT) == MOST_M_S
    assert speed(only(3, CLOSE_M)) == MOST_M_S


@each("sonar", AHEAD)
def test_nearer_echo_ahead_means_lower_speed(sonar: int) -> None:
    speeds_m_s = [speed(only(sonar, 0.01 * k)) for k in range(2, 40)]
    assert speeds_m_s == sorted(speeds_m_s)
    assert speeds_m_s[0] < 0.05 < speeds_m_s[-1]


@each("sonar", AHEAD)
def test_speed_is_zero_where_the_guard_would_stop(sonar: int) -> None:
    assert speed(only(sonar, DEFAULTS.guard_stop_m)) == 0.0


@each("sonar", [0, 7])
def test_wall_beside_is_passed_fast_unless_nearly_touching(sonar: int) -> None:
    assert speed(only(sonar, 0.12)) == MOST_M_S
    assert 0.0 < speed(only(sonar, 0.03)) < MOST_M_S


@each(("right_m", "left_m"), [(0.02, 0.02), (0.02, 0.029), (0.029, 0.02)])
@each("right", [0, 1])
@each("left", [6, 7])
def test_gap_of_unknown_width_is_not_entered(
    right_m: float, left_m: float, right: int, left: int
) -> None:
    ranges: Ranges = [inf] * SONARS
    ranges[right], ranges[left] = right_m, left_m
    assert speed(heard(ranges)) == 0.0


@each("sonar", [0, 1, 6, 7])
def test_only_turns_at_the_least_range_of_a_flank_sonar(sonar: int) -> None:
    assert speed(only(sonar, 0.02)) == 0.0
    assert speed(only(sonar, 0.021)) > 0.0


@each("sonar", [0, 1, 6, 7])
def test_only_turns_while_a_lost_saturated_echo_is_held(sonar: int) -> None:
    lost = [SILENT] * int(SATURATED_M / RISE_M)
    assert pace.speed(held(only(sonar, 0.02), *lost), FREE_MM, 0.0, DEFAULTS) == 0.0
    assert pace.speed(held(only(sonar, 0.02), *lost, SILENT), FREE_MM, 0.0, DEFAULTS) > 0.0


def test_gap_with_three_centimetres_each_side_is_entered() -> None:
    assert speed(heard([0.03, 0.032, inf, inf, inf, inf, 0.034, 0.03])) > 0.0


def test_little_room_ahead_slows_down_and_none_stops() -> None:
    speeds_m_s = [speed(SILENT, free_mm) for free_mm in range(0, FREE_MM, 10)]
    assert speeds_m_s == sorted(speeds_m_s)
    assert speeds_m_s[0] == 0.0
    assert speeds_m_s[-1] == MOST_M_S


def test_it_turns_before_it_goes() -> None:
    speeds_m_s = [speed(SILENT, error_rad=0.05 * k) for k in range(60)]
    assert speeds_m_s == sorted(speeds_m_s, reverse=True)
    assert speed(SILENT, error_rad=0.5 * pi + 0.01) == 0.0


@given(rings, rooms, errors)
def test_the_speed_is_never_negative_nor_more_than_it_can(
    seen: Ring, free_mm: int, error_rad: float
) -> None:
    assert 0.0 <= speed(seen, free_mm, error_rad) <= MOST_M_S


@given(rings, rooms, errors)
def test_the_speed_is_the_same_in_the_mirror(seen: Ring, free_mm: int, error_rad: float) -> None:
    mirror_m_s = speed(mirrored(seen), free_mm, -error_rad)
    assert speed(seen, free_mm, error_rad) == pytest.approx(mirror_m_s, abs=1e-12)


@given(rings, st.integers(0, SONARS - 1), st.floats(0.02, 0.3), rooms)
def test_additional_echo_never_increases_the_speed(
    seen: Ring, sonar: int, range_m: float, free_mm: int
) -> None:
    more = list(seen.range_m)
    more[sonar] = min(range_m, here_m if (here_m := more[sonar]) is not None else inf)
    assert speed(heard(more), free_mm) <= speed(seen, free_mm)


@each("sonar", range(SONARS))
def test_it_keeps_off_a_flank_that_is_too_near(sonar: int) -> None:
    towards_left = sonar >= SONARS // 2
    away_rad = keep_off(only(sonar, 0.5 * FLANK_M))
    assert (away_rad < 0.0) == towards_left
    assert away_rad != 0.0
    assert abs(keep_off(only(sonar, 0.25 * FLANK_M))) > abs(away_rad)


def test_equal_or_far_flanks_do_not_bias_the_heading() -> None:
    both: Ranges = [inf] * SONARS
    both[0] = both[7] = 0.5 * FLANK_M
    assert keep_off(heard(both)) == 0.0
    assert keep_off(only(0, FLANK_M)) == 0.0
    assert keep_off(SILENT) == 0.0


@given(rings)
def test_it_keeps_off_the_other_way_in_the_mirror(seen: Ring) -> None:
    assert keep_off(mirrored(seen)) == -keep_off(seen)
    assert abs(keep_off(seen)) < 0.5 * pi


@each("sonar", range(SONARS))
def test_lost_near_echo_is_held_and_fades(sonar: int) -> None:
    ranges = held(only(sonar, 0.05), SILENT)
    assert ranges.range_m[sonar] == ranges.nearest_m == 0.05 + RISE_M
    ticks = int((HOLD_M - 0.05) / RISE_M) + 2
    assert held(only(sonar, 0.05), *[SILENT] * ticks).nearest_m == inf


def test_far_echo_is_not_held_and_nearer_one_counts_at_once() -> None:
    assert held(only(3, HOLD_M), SILENT).nearest_m == inf
    assert held(only(3, 0.09), only(3, 0.04)).range_m[3] == 0.04


def test_it_stays_slow_while_single_echoes_are_lost() -> None:
    slow_m_s = pace.speed(held(only(5, 0.05)), FREE_MM, 0.0, DEFAULTS)
    lost_m_s = pace.speed(held(only(5, 0.05), SILENT), FREE_MM, 0.0, DEFAULTS)
    assert slow_m_s < lost_m_s < 0.5 * MOST_M_S


def test_heading_weaves_to_both_sides_without_echo_ahead() -> None:
    biases = {pace.weave(SILENT, WEAVE_FROM_M + 0.3 * WEAVE_M * k) for k in range(20)}
    assert biases == {WEAVE_RAD, -WEAVE_RAD}


def test_heading_does_not_weave_near_goal_or_with_echo_ahead() -> None:
    assert pace.weave(SILENT, 0.99 * WEAVE_FROM_M) == 0.0
    assert pace.weave(only(3, 2.9), 5.0) == pace.weave(only(4, 0.5), 5.0) == 0.0


def test_heading_bends_to_and_fro_until_near_the_goal() -> None:
    biases = [pace.dither(5.0 + DITHER_M * (k + 0.5)) for k in range(6)]
    assert biases == [biases[0], -biases[0]] * 3
    assert abs(biases[0]) == DITHER_RAD
    assert pace.dither(0.99 * WEAVE_FROM_M) == 0.0


def free(seen: Ring, alpha_rad: float, distance_m: float = 10.0) -> float:
    return pace.free_towards(seen, alpha_rad, distance_m, DEFAULTS)


@each("alpha_rad", [BESIDE, -BESIDE, 2.0, -3.0, pi])
def test_where_no_sonar_looks_nothing_is_known_to_be_free(alpha_rad: float) -> None:
    assert free(SILENT, alpha_rad) == 0.0


def test_a_way_without_echoes_is_free_as_far_as_sonars_reach() -> None:
    assert free(SILENT, 0.3, 2.0) == 2.0
    assert free(SILENT, 0.3, 10.0) == DEFAULTS.sonar_max_m - LOOK_M


@each("sonar", range(SONARS))
def test_an_echo_in_the_way_ends_what_is_free_before_it(sonar: int) -> None:
    assert free(only(sonar, 1.2), BEARINGS[sonar]) == pytest.approx(1.2 - LOOK_M)
    assert free(only(sonar, 1.2), BEARINGS[sonar], 1.0) == 1.0
    assert free(only(sonar, 0.1), BEARINGS[sonar]) == 0.0


def test_an_echo_aside_that_the_body_passes_leaves_the_way_free() -> None:
    assert free(only(7, 0.5), 0.0) == DEFAULTS.sonar_max_m - LOOK_M
    assert free(only(5, 0.05), 0.0) < 0.1


@each("sonar", range(SONARS))
def test_missing_measurement_means_no_free_distance(sonar: int) -> None:
    ranges: Ranges = [inf] * SONARS
    ranges[sonar] = None
    assert free(heard(ranges), BEARINGS[sonar]) == 0.0
    assert free(heard(ranges), BEARINGS[(sonar + 4) % SONARS]) > 0.0


@given(rings, errors, st.floats(0.0, 20.0))
def test_free_distance_is_at_most_that_of_the_goal(
    seen: Ring, alpha_rad: float, distance_m: float
) -> None:
    assert 0.0 <= free(seen, alpha_rad, distance_m) <= free(SILENT, alpha_rad, distance_m)


@given(st.integers(0, SONARS - 1), st.floats(0.02, 3.0), errors, st.floats(0.0, 20.0))
def test_free_distance_is_symmetric(
    sonar: int, range_m: float, alpha_rad: float, distance_m: float
) -> None:
    seen = only(sonar, range_m)
    mirror_m = free(mirrored(seen), -alpha_rad, distance_m)
    assert free(seen, alpha_rad, distance_m) == pytest.approx(mirror_m, abs=1e-9)


def test_a_slow_way_sweeps_the_cones_as_long_to_one_side_as_to_the_other() -> None:
    sweeps = [pace.sweep(turn) for turn in range(FADE_TURNS)]
    assert sum(sweeps) == pytest.approx(0.0)
    assert {abs(one) for one in sweeps} == {DITHER_RAD}
    assert sweeps[:DITHER_TURNS] == [sweeps[0]] * DITHER_TURNS
    assert sweeps[DITHER_TURNS] == -sweeps[0]
