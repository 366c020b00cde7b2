"""Sonars: the ring, echoes over time, frozen sensors, and inputs made of messages."""

from math import cos, hypot, inf, pi, sin
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core.parameters import DEFAULTS
from robot.core.perception import echoes as echo_decay
from robot.core.perception import echoes as memory
from robot.core.perception import sonar_ring
from robot.core.perception import sonar_ring as rings
from robot.core.perception.echoes import (
    BRADS,
    CIRCLE,
    CONE,
    CORE,
    FADE_TURNS,
    FEW,
    FIRM_MM,
    FIRM_STEP,
    FIRM_WEIGHT,
    FORGET_MM2,
    HALF_CIRCLE,
    MAX_WEIGHT,
    NEAR_M,
    NOTHING,
    POINTS,
    REACH_M,
    SLICES,
    SURE,
    THROUGH_MM,
    Echoes,
)
from robot.core.perception.sonar_ring import FrozenSonar, Ring
from robot.core.ring import BEARINGS, SONARS
from robot.core.values import Pose, Scan, Wheels, goal_of, now_ms_of, scan_of, wheels_of
from tests.support.cores import (
    HERE,
    RADIUS_MM,
    SILENT,
    Ranges,
    any_ranges,
    heard,
    ring,
    scan,
)
from tests.support.each import each


def drive(
    sonars: FrozenSonar, one: Scan, ticks: int, moved_m: float = 0.015, turned: float = 0.0
) -> None:
    for _ in range(ticks):
        sonar_ring.watch(sonars, one, moved_m, turned, DEFAULTS)


def test_echoes_that_ignore_a_turn_are_frozen() -> None:
    sonars = FrozenSonar()
    drive(sonars, scan({2: 1500, 6: 800}), ticks=12, turned=0.02)
    assert sonars.verdict
    drive(sonars, scan({2: 1501, 6: 800}), ticks=1)
    assert not sonars.verdict


def test_an_echo_close_ahead_that_does_not_come_closer_is_frozen() -> None:
    sonars = FrozenSonar()
    drive(sonars, scan({3: 350}), ticks=6)
    assert not sonars.verdict
    drive(sonars, scan({3: 350}), ticks=3)
    assert sonars.verdict


def test_a_straight_corridor_without_noise_is_not_frozen() -> None:
    sonars = FrozenSonar()
    drive(sonars, scan({0: 280, 7: 280, 1: 313, 6: 320, 2: 446, 5: 470}), ticks=200)
    assert not sonars.verdict


def test_standing_still_and_empty_space_are_not_frozen() -> None:
    standing, empty = FrozenSonar(), FrozenSonar()
    drive(standing, scan({3: 200}), ticks=200, moved_m=0.0)
    drive(empty, scan({}), ticks=200, turned=0.1)
    assert not standing.verdict
    assert not empty.verdict


def test_noisy_sonars_that_fall_silent_in_a_corridor_are_frozen() -> None:
    sonars = FrozenSonar()
    for k in range(8):
        drive(sonars, scan({0: 280 + k % 3, 7: 280}), ticks=1, moved_m=0.0)
    drive(sonars, scan({0: 280, 7: 280}), ticks=9)
    assert sonars.verdict


def test_circling_a_disc_is_not_frozen_turning_beside_it_is() -> None:
    circling, turning = FrozenSonar(), FrozenSonar()
    drive(circling, scan({0: 150, 1: 210, 2: 390}), ticks=200, turned=-0.02)
    drive(turning, scan({0: 150, 1: 210, 2: 390}), ticks=40, moved_m=0.004, turned=-0.04)
    assert not circling.verdict
    assert turning.verdict


def test_an_echo_ahead_that_stops_coming_closer_is_frozen() -> None:
    sonars = FrozenSonar()
    for k in range(5):
        drive(sonars, scan({0: 1880, 3: 900 - 15 * k, 7: 1880}), ticks=1)
    drive(sonars, scan({0: 1880, 3: 840, 7: 1880}), ticks=5)
    assert not sonars.verdict
    drive(sonars, scan({0: 1880, 3: 840, 7: 1880}), ticks=3)
    assert sonars.verdict


def test_echo_ahead_that_never_closed_may_be_a_wall() -> None:
    sonars = FrozenSonar()
    drive(sonars, scan({0: 1880, 3: 2017, 4: 2017, 7: 1880}), ticks=40)
    assert not sonars.verdict


def test_alternating_echoes_that_then_stay_are_frozen() -> None:
    noisy, smooth = FrozenSonar(), FrozenSonar()
    for k in range(8):
        drive(noisy, scan({0: 900 + 8 * (k % 2)}), ticks=1)
        drive(smooth, scan({0: 900 + 8 * k}), ticks=1)
    drive(noisy, scan({0: 900}), ticks=8)
    drive(smooth, scan({0: 900}), ticks=8)
    assert noisy.verdict
    assert not smooth.verdict


def test_a_missing_scan_is_not_judged() -> None:
    sonars = FrozenSonar()
    sonar_ring.watch(sonars, None, 1.0, 1.0, DEFAULTS)
    assert not sonars.verdict


def test_on_a_bend_only_a_close_echo_ahead_must_change() -> None:
    close, far = FrozenSonar(), FrozenSonar()
    drive(close, scan({2: 300, 3: 350}), ticks=8, turned=0.012)
    drive(far, scan({2: 300}), ticks=8, turned=0.012)
    assert close.verdict
    assert not far.verdict


def swinging(turned_rad: float) -> FrozenSonar:
    """Drive on while an echo alternates by 12 mm, and then no longer does."""
    sonars = FrozenSonar()
    for k in range(12):
        drive(sonars, scan({0: 280, 2: 500 + 12 * (k % 2), 7: 280}), ticks=1, turned=turned_rad)
    drive(sonars, scan({0: 280, 2: 500, 7: 280}), ticks=9)
    return sonars


def test_echoes_of_a_wavering_robot_are_not_noise() -> None:
    assert swinging(0.0).verdict
    assert not swinging(0.01).verdict


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


OPEN = (0,) * 8


def seen(one: Scan, now_ms: int = 0) -> Ring:
    ring = Ring()
    rings.update(ring, one, now_ms, DEFAULTS)
    return ring


def test_before_the_first_scan_everything_is_missing() -> None:
    ring = Ring()
    rings.update(ring, None, 0, DEFAULTS)
    assert ring.range_m == [None] * 8
    assert (ring.fresh, ring.nearest, ring.nearest_m) == (0, -1, inf)
    assert rings.bearing_rad(ring) is None


def test_no_echo_is_infinitely_far_and_not_missing() -> None:
    ring = seen(scan({}))
    assert ring.range_m == [inf] * 8
    assert ring.fresh == 8
    assert rings.bearing_rad(ring) is None


def test_the_nearest_echo_and_its_bearing() -> None:
    ring = seen(scan({1: 900, 6: 400, 3: 1200}))
    assert (ring.nearest, ring.nearest_m) == (6, 0.4)
    assert rings.bearing_rad(ring) == BEARINGS[6]
    assert ring.front_m == 1.2


def test_a_dead_sonar_is_missing_and_the_others_are_not() -> None:
    ring = seen(scan({3: 500}, valid=0xFF & ~(1 << 3)))
    assert ring.range_m[3] is None
    assert ring.fresh == 7
    assert ring.nearest == -1


def test_each_sonar_grows_stale_by_the_age_of_its_own_ping() -> None:
    ring = seen(scan({0: 500, 1: 600}))
    rings.update(ring, None, 125, DEFAULTS)
    assert ring.range_m[:2] == [0.5, 0.6]
    rings.update(ring, None, 130, DEFAULTS)  # group A was pinged 25 ms before the stamp
    assert ring.range_m[:2] == [None, 0.6]
    rings.update(ring, None, 151, DEFAULTS)
    assert ring.fresh == 0


def test_echo_at_zero_or_beyond_the_range_is_impossible() -> None:
    for impossible_mm in (0, 3301, 65535):
        ring = seen(scan({4: impossible_mm}))
        assert ring.impossible
        assert ring.range_m[4] is None
    rings.update(ring, scan({4: 3000}), 50, DEFAULTS)
    assert not ring.impossible
    assert not seen(scan({4: 3200})).impossible  # noise at the far end


@given(st.lists(st.one_of(st.none(), st.integers(1, 3000)), min_size=8, max_size=8))
def test_the_nearest_is_never_farther_than_any_echo(ranges_mm: list[int | None]) -> None:
    echoes = {i: mm for i, mm in enumerate(ranges_mm) if mm is not None}
    ring = seen(scan(echoes))
    assert ring.nearest_m == min(echoes.values(), default=inf) / 1000
    assert ring.nearest_m <= ring.front_m


def look(
    echoes: Echoes,
    seen: Ring,
    looks: int,
    pose: Pose = HERE,
    before: Pose | None = None,
) -> None:
    for _ in range(looks):
        echo_decay.update_through(echoes, seen, RADIUS_MM)
        echo_decay.fade(echoes, pose)
        memory.record(echoes, before or pose, pose, seen, RADIUS_MM)


def remembered(seen: Ring, looks: int = 2, pose: Pose = HERE) -> Echoes:
    echoes = Echoes()
    look(echoes, seen, looks, pose)
    return echoes


def blind() -> Ring:
    """Return a ring without any measurement."""
    return Ring()


def test_an_echo_is_confirmed_by_a_second_and_counts() -> None:
    echoes = remembered(ring({3: 300}), 1)
    assert echoes.count == 1
    assert echoes.weight[0] < SURE
    look(echoes, ring({3: 300}), 1)
    assert echoes.count == 1
    assert echoes.weight[0] >= SURE


def test_single_near_echo_counts_and_is_firm() -> None:
    echoes = remembered(ring({3: 90}), 1)
    assert echoes.spread_mm[0] <= FIRM_MM
    assert echoes.weight[0] == FIRM_STEP >= SURE
    look(echoes, ring({3: 90}), 10)
    assert echoes.weight[0] == FIRM_WEIGHT


def distance_mm(echoes: Echoes, k: int) -> float:
    return hypot(echoes.x_mm[k], echoes.y_mm[k])


@each("sonar", range(SONARS))
def test_point_of_a_saturated_range_is_at_the_rim(sonar: int) -> None:
    echoes = remembered(ring({sonar: 20}), 1)
    assert distance_mm(echoes, 0) == pytest.approx(RADIUS_MM, abs=2.0)
    assert distance_mm(remembered(ring({sonar: 21}), 1), 0) == pytest.approx(RADIUS_MM + 21, abs=2)


def test_saturated_range_moves_a_stored_point_to_the_rim() -> None:
    echoes = remembered(ring({6: 30}))
    look(echoes, ring({6: 20}), 1)
    assert echoes.count == 1
    assert distance_mm(echoes, 0) == pytest.approx(RADIUS_MM, abs=2.0)
    look(echoes, ring({6: 25}), 20)
    assert distance_mm(echoes, 0) == pytest.approx(RADIUS_MM + 25, abs=4.0)


def looks_until_erased(range_mm: int) -> int:
    echoes = remembered(ring({3: range_mm}), 8)
    for looks in range(1, 100):
        look(echoes, ring({3: 2000}), 1)
        if echoes.weight[0] < SURE or echoes.count == 0:
            return looks
    return 100


def test_firm_point_outlasts_longer_echoes_three_times_as_long() -> None:
    assert 3 * looks_until_erased(300) <= looks_until_erased(90) < 100


@each(("more_mm", "moved_mm"), [(10, 5), (-10, -5), (-20, -20), (24, 3)])
def test_nearer_echo_moves_a_firm_point_more_than_a_longer_one(more_mm: int, moved_mm: int) -> None:
    """Within the noise half of the way; a longer echo may come from beside a wall's end."""
    echoes = remembered(ring({3: 80}), 4)
    before_mm = distance_mm(echoes, 0)
    look(echoes, ring({3: 80 + more_mm}), 1)
    assert echoes.count == 1
    assert distance_mm(echoes, 0) - before_mm == pytest.approx(moved_mm, abs=1.5)


@each("sonar", range(SONARS))
def test_near_ring_stores_the_nearest_echo_and_those_ahead(sonar: int) -> None:
    echoes = Echoes()
    seen = ring({**dict.fromkeys(range(SONARS), 240), sonar: 200})
    memory.record_nearest(echoes, HERE, HERE, seen, RADIUS_MM)
    stored = {sonar, *sonar_ring.AHEAD}
    assert {i for i in range(SONARS) if echoes.last[i] != NOTHING} == stored
    assert echoes.count == len({echoes.last[i] for i in stored})


def test_echo_ahead_is_stored_beside_a_nearer_wall_if_near() -> None:
    echoes = Echoes()
    near_mm = int(1000 * NEAR_M)
    memory.record_nearest(echoes, HERE, HERE, ring({0: 80, 3: near_mm + 1}), RADIUS_MM)
    assert echoes.count == 1
    memory.record_nearest(echoes, HERE, HERE, ring({0: 80, 3: near_mm - 1}), RADIUS_MM)
    assert echoes.count == 2
    assert echoes.last[3] != NOTHING


def test_an_even_sonar_ahead_was_pinged_halfway() -> None:
    echoes = Echoes()
    memory.record_nearest(echoes, HERE, Pose(0.1, 0.0, 0.0), ring({0: 80, 4: 200}), RADIUS_MM)
    expected_m = 0.05 + (0.2 + 0.001 * RADIUS_MM) * cos(pi / 16)
    assert echoes.x_mm[echoes.last[4]] == pytest.approx(1000 * expected_m, abs=3)


def test_of_a_far_ring_the_nearest_echo_is_not_stored() -> None:
    echoes = Echoes()
    memory.record_nearest(echoes, HERE, HERE, ring({3: int(1000 * NEAR_M) + 1}), RADIUS_MM)
    memory.record_nearest(echoes, HERE, HERE, SILENT, RADIUS_MM)
    assert echoes.count == 0


@each("sonar", range(SONARS))
@each("heading_rad", [0.0, 1.0, -2.5])
def test_a_point_lies_where_its_sonar_looks(sonar: int, heading_rad: float) -> None:
    pose = Pose(1.5, -0.7, heading_rad)
    echoes = remembered(ring({sonar: 400}), 2, pose)
    away_m, bearing_rad = 0.4 + 0.001 * RADIUS_MM, heading_rad + BEARINGS[sonar]
    assert echoes.x_mm[0] == pytest.approx(1000.0 * (1.5 + away_m * cos(bearing_rad)), abs=4)
    assert echoes.y_mm[0] == pytest.approx(1000.0 * (-0.7 + away_m * sin(bearing_rad)), abs=4)


def test_ping_between_two_ticks_is_placed_between_poses() -> None:
    echoes = Echoes()
    look(echoes, ring({4: 300}), 1, Pose(0.04, 0.0, -BEARINGS[4]), Pose(0.00, 0.0, -BEARINGS[4]))
    assert echoes.count == 1
    assert echoes.x_mm[0] == pytest.approx(20 + RADIUS_MM + 300, abs=3)


def test_halfway_between_two_headings_is_the_short_way_round() -> None:
    echoes = Echoes()
    before = Pose(0.0, 0.0, pi - 0.05 - BEARINGS[4])
    look(echoes, ring({4: 300}), 1, Pose(0.0, 0.0, -pi + 0.05 - BEARINGS[4]), before)
    assert echoes.x_mm[0] == pytest.approx(-RADIUS_MM - 300, abs=3)
    assert echoes.y_mm[0] == pytest.approx(0, abs=4)


def test_a_longer_echo_through_its_place_erases_a_point() -> None:
    echoes = remembered(ring({2: 300}))
    look(echoes, ring({2: 2000}), SLICES * (MAX_WEIGHT + 1))
    assert echoes.count == 0


@each("sonar", [3, 4])
def test_a_point_ahead_is_not_forgotten_at_once(sonar: int) -> None:
    echoes = remembered(ring({sonar: 300}))
    look(echoes, ring({sonar: 2000}), SLICES * (MAX_WEIGHT + 1))
    assert echoes.count == 1
    assert 0 < echoes.weight[0] < SURE
    look(echoes, ring({sonar: 2000}), FADE_TURNS)
    assert echoes.count == 0


@each(("sonar", "count"), [(2, 0), (3, 1), (4, 1), (5, 0)])
def test_longer_echoes_erase_a_single_one_unless_it_is_ahead(sonar: int, count: int) -> None:
    echoes = remembered(ring({sonar: 300}), 1)
    look(echoes, ring({sonar: 2000}), 2 * SLICES)
    assert echoes.count == count


@each("seen", [SILENT, blind()])
def test_no_echo_at_all_erases_nothing(seen: Ring) -> None:
    echoes = remembered(ring({3: 300}))
    look(echoes, seen, SLICES * (MAX_WEIGHT + 1))
    assert echoes.count == 1
    assert echoes.weight[0] >= SURE


def test_a_longer_echo_elsewhere_erases_nothing() -> None:
    echoes = remembered(ring({3: 300}))
    look(echoes, ring({6: 2000}), SLICES * (MAX_WEIGHT + 1))
    assert echoes.count == 1


def test_point_without_new_echoes_is_dropped_in_the_end() -> None:
    echoes = remembered(ring({3: 300}))
    look(echoes, SILENT, FADE_TURNS * (MAX_WEIGHT + 1))
    assert echoes.count == 0


def test_what_is_seen_all_the_time_stays() -> None:
    echoes = remembered(ring({3: 300}))
    look(echoes, ring({3: 300}), FADE_TURNS * (MAX_WEIGHT + 1))
    assert echoes.count == 1
    assert echoes.weight[0] >= SURE


def test_what_is_far_away_by_now_is_forgotten_soon() -> None:
    echoes = remembered(ring({3: 300}))
    look(echoes, SILENT, SLICES, Pose(-0.002 * FORGET_MM2**0.5, 0.0, 0.0))
    assert echoes.count == 0


def test_echoes_from_afar_are_not_remembered() -> None:
    assert remembered(ring({3: int(1000 * REACH_M) + 10})).count == 0


@each(
    ("echoes_mm", "lean"),
    [
        ({3: 300}, 0),
        ({3: 300, 4: 250}, 1),
        ({3: 300, 2: 250}, -1),
        ({3: 300, 2: 250, 4: 250}, 0),
        ({3: 300, 4: 350}, 0),
        ({3: 600, 4: 30}, 0),  # no surface spans such ranges within a cone
    ],
)
def test_an_echo_leans_to_the_neighbour_that_sees_it_nearer(
    echoes_mm: dict[int, int], lean: int
) -> None:
    seen = ring(echoes_mm)
    range_m = seen.range_m[3]
    assert range_m is not None
    assert memory.leaning(seen, 3, range_m, RADIUS_MM) == lean


@each(("sonar", "neighbour"), [(0, 1), (7, 6)])
def test_the_outermost_sonars_have_one_neighbour_to_lean_to(sonar: int, neighbour: int) -> None:
    seen = ring({sonar: 300, neighbour: 250})
    assert memory.leaning(seen, sonar, 0.3, RADIUS_MM) == neighbour - sonar


@each("neighbour", [2, 4])
def test_leaning_point_is_aside_with_a_smaller_spread(neighbour: int) -> None:
    upright = remembered(ring({3: 300}), 1)
    leaning = remembered(ring({3: 300, neighbour: 250}), 1)
    turned_mm = leaning.y_mm[0] - upright.y_mm[0]
    assert turned_mm * (neighbour - 3) > 20
    away_mm = hypot(leaning.x_mm[0], leaning.y_mm[0])
    assert away_mm == pytest.approx(300 + RADIUS_MM, abs=4)
    assert leaning.spread_mm[0] < upright.spread_mm[0]


def test_nearer_echo_reduces_the_spread() -> None:
    echoes, doubts_mm = Echoes(), []
    for k in range(50):
        pose = Pose(0.01 * k, 0.0, -BEARINGS[3])
        look(echoes, ring({3: 700 - 10 * k}), 1, pose)
        doubts_mm.append(echoes.spread_mm[0])
    assert echoes.count == 1
    assert doubts_mm[-1] < doubts_mm[0] // 2
    assert echoes.x_mm[0] == pytest.approx(700 + RADIUS_MM, abs=20)


@each("far", range(POINTS))
def test_when_there_is_no_room_the_farthest_of_the_next_few_goes(far: int) -> None:
    echoes = Echoes()
    echoes.count = POINTS
    for k in range(POINTS):
        echoes.x_mm[k], echoes.y_mm[k], echoes.weight[k] = 300, k - POINTS // 2, SURE
    echoes.x_mm[far] = 800
    assert far in {memory.vacant(echoes, 0, 0) for _ in range(POINTS // FEW)}
    assert echoes.count == POINTS


def test_while_there_is_room_nothing_goes() -> None:
    echoes = remembered(ring({0: 250, 3: 250}))
    assert memory.vacant(echoes, 0, 0) == 2
    assert echoes.count == 3


def test_a_forgotten_point_leaves_the_others_as_they_were() -> None:
    echoes = remembered(ring({0: 250, 3: 300, 7: 400}))
    places = list(zip(echoes.x_mm[:3], echoes.y_mm[:3], echoes.spread_mm[:3], strict=True))
    memory.drop(echoes, 0)
    left = list(zip(echoes.x_mm[:2], echoes.y_mm[:2], echoes.spread_mm[:2], strict=True))
    assert sorted(left) == sorted(places[1:])


def test_cleared_there_is_nothing_to_confirm() -> None:
    echoes = remembered(ring({3: 300, 4: 300}))
    memory.clear(echoes)
    assert echoes.count == 0
    look(echoes, ring({3: 300}), 1)
    assert echoes.count == 1
    assert echoes.weight[0] < SURE


def passed_through(seen: Ring, bearing: int, range_mm: int) -> bool:
    echoes = Echoes()
    echoes.count = 1
    echo_decay.update_through(echoes, seen, RADIUS_MM)
    return (range_mm + RADIUS_MM) ** 2 < echoes.through_mm2[echo_decay.contradicting(bearing, SURE)]


def bearing_of(sonar: int) -> int:
    return int(BRADS * BEARINGS[sonar])


@given(st.integers(0, SONARS - 1), st.integers(-CORE + 2, CORE - 2), st.integers(0, 1000))
def test_a_sonar_sees_through_places_well_before_its_echo(
    sonar: int, aside: int, range_mm: int
) -> None:
    behind_mm = (range_mm + THROUGH_MM) * 104 // 100 + 2
    bearing = bearing_of(sonar) + aside
    assert passed_through(ring({sonar: behind_mm}), bearing, range_mm)
    assert passed_through(ring({sonar: behind_mm}), bearing - CIRCLE, range_mm)
    assert not passed_through(ring({sonar: range_mm + THROUGH_MM}), bearing, range_mm)
    assert not passed_through(SILENT, bearing, range_mm)
    assert not passed_through(blind(), bearing, range_mm)


@given(st.integers(0, SONARS - 1), st.integers(CORE + 2, CONE // 2 - 2), st.sampled_from([1, -1]))
def test_at_the_edge_of_its_cone_a_sonar_proves_nothing(sonar: int, aside: int, side: int) -> None:
    all_far = ring(dict.fromkeys(range(SONARS), 2500))
    assert not passed_through(all_far, bearing_of(sonar) + side * aside, 200)


@given(st.integers(HALF_CIRCLE // 2 + 2, HALF_CIRCLE * 3 // 2 - 2))
def test_nothing_is_seen_through_behind_the_robot(bearing: int) -> None:
    all_far = ring(dict.fromkeys(range(SONARS), 2500))
    assert not passed_through(all_far, bearing, 200)


places = st.builds(Pose, st.floats(-1, 1), st.floats(-1, 1), st.floats(-pi, pi))


@given(st.lists(st.tuples(any_ranges, places), max_size=60))
def test_any_echoes_keep_size_and_integers_of_the_memory(
    story: list[tuple[Ranges, Pose]],
) -> None:
    echoes = Echoes()
    for range_m, pose in story:
        look(echoes, heard(range_m), 1, pose)
        assert 0 <= echoes.count <= POINTS
        assert all(NOTHING <= k < POINTS for k in echoes.last)
        for k in range(echoes.count):
            assert 0 < echoes.weight[k] <= FIRM_WEIGHT
            assert echoes.spread_mm[k] > 0
            assert isinstance(echoes.x_mm[k], int)
            assert isinstance(echoes.y_mm[k], int)
    for kept in (echoes.x_mm, echoes.y_mm, echoes.weight, echoes.spread_mm):
        assert len(kept) == POINTS
