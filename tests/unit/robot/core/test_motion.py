"""Motion: the controller, its pace, the trail, and plane geometry."""

from itertools import pairwise
from math import cos, degrees, inf, isnan, nan, pi, sin

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from robot.core import motion
from robot.core import motion as trails
from robot.core.motion import LIMIT, PASSED_M, SPACING_M, Trail, into, limited, ramp, toward
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
from robot.core.ring import BEARINGS, SONARS
from robot.core.values import COSINES, SINES, Twist, wrap
from tests.support.cores import SILENT, Ranges, heard
from tests.support.each import each

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


def walked(distance_m: float) -> Trail:
    trail = Trail()
    for k in range(int(distance_m / 0.015) + 1):
        trails.drop_crumb(trail, k * 0.015, 0.0)
    return trail


def newest_m(trail: Trail) -> float:
    return trail.xs_m[trail.count - 1]


def test_crumbs_are_a_spacing_apart() -> None:
    trail = walked(5.0)
    used_m = trail.xs_m[: trail.count]
    gaps = [b - a for a, b in pairwise(used_m)]
    assert len(gaps) == 19
    assert all(SPACING_M <= gap < SPACING_M + 0.02 for gap in gaps)


@given(st.floats(0.0, 400.0))
def test_trail_is_bounded_and_begins_at_the_start(far_m: float) -> None:
    trail = walked(far_m)
    assert 1 <= trail.count <= LIMIT
    assert (trail.xs_m[0], trail.ys_m[0]) == (0.0, 0.0)
    assert far_m - newest_m(trail) <= 2 * trail.spacing_m + 0.02


def test_crumbs_are_taken_up_from_the_newest_and_the_start_stays() -> None:
    trail = walked(1.0)
    before_m = newest_m(trail)
    assert not trails.pass_crumb(trail, before_m + PASSED_M + 0.01, 0.0)
    assert trails.pass_crumb(trail, before_m + PASSED_M - 0.01, 0.0)
    assert newest_m(trail) < before_m
    while trails.pass_crumb(trail, newest_m(trail), 0.0):
        pass
    assert (trail.count, newest_m(trail)) == (1, 0.0)


def test_lists_of_the_trail_never_change_their_length() -> None:
    trail = Trail()
    xs_m, ys_m = trail.xs_m, trail.ys_m
    for k in range(10 * LIMIT):
        trails.drop_crumb(trail, float(k * LIMIT), 0.0)
        assert trail.xs_m is xs_m
        assert trail.ys_m is ys_m
        assert len(xs_m) == len(ys_m) == LIMIT
    trails.pass_crumb(trail, newest_m(trail), 0.0)
    assert len(xs_m) == len(ys_m) == LIMIT


@given(st.floats(-1e6, 1e6))
def test_wrapped_angle_has_the_same_direction(angle_rad: float) -> None:
    wrapped_rad = wrap(angle_rad)
    assert -pi < wrapped_rad <= pi
    assert cos(wrapped_rad) == pytest.approx(cos(angle_rad), abs=1e-9)
    assert sin(wrapped_rad) == pytest.approx(sin(angle_rad), abs=1e-9)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_whatever_the_size_the_result_is_within_half_a_turn(angle_rad: float) -> None:
    assert -pi < wrap(angle_rad) <= pi


def test_half_a_turn_is_counted_to_the_left() -> None:
    assert wrap(pi) == pi
    assert wrap(-pi) == pi
    assert wrap(3 * pi) == pytest.approx(pi)


@each("nowhere", [nan, inf, -inf])
def test_infinite_angle_becomes_nan(nowhere: float) -> None:
    assert isnan(wrap(nowhere))


def test_eight_cones_tile_the_half_circle_from_right_to_left() -> None:
    bearings = [degrees(bearing) for bearing in BEARINGS]
    assert bearings == pytest.approx([-78.75, -56.25, -33.75, -11.25, 11.25, 33.75, 56.25, 78.75])
    assert pytest.approx([1.0] * 8) == [c * c + s * s for c, s in zip(COSINES, SINES, strict=True)]
