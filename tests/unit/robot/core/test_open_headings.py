"""Open headings among the echoes, and the sweep that looks for them."""

from math import acos, asin, cos, hypot, pi, sin, sqrt

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from robot.core.navigators import open_headings
from robot.core.navigators import open_headings as sweeps
from robot.core.navigators.open_headings import (
    CLEAR_MM,
    FEW,
    FREE_MM,
    LOOK_MM,
    NEAR,
    SQUEEZE_MM,
    TABLE,
    TIGHT_MM,
    WARY_MM,
    WIDE_MM,
    Sectors,
    squeeze,
)
from robot.core.perception.echoes import (
    BRADS,
    CIRCLE,
    FIRM_MM,
    HALF_CIRCLE,
    MAX_WEIGHT,
    NOTHING,
    QUARTER,
    SURE,
    Echoes,
    record,
    update_through,
)
from robot.core.perception.sonar_ring import Ring
from robot.core.ring import BEARINGS
from robot.core.values import Pose
from tests.support.cores import HERE, RADIUS_MM, SILENT, Ranges, any_ranges, heard, ring
from tests.support.each import each

SLIM_MM = RADIUS_MM + SQUEEZE_MM
sides = st.sampled_from([1, -1])


def points(*places_mm: tuple[int, int], weight: int = MAX_WEIGHT, spread_mm: int = 0) -> Echoes:
    echoes = Echoes()
    echoes.count = len(places_mm)
    for k, (x_mm, y_mm) in enumerate(places_mm):
        echoes.x_mm[k], echoes.y_mm[k] = x_mm, y_mm
        echoes.weight[k], echoes.spread_mm[k] = weight, spread_mm
    return echoes


def measured(echoes: Echoes, pose: Pose = HERE, seen: Ring = SILENT, ease_mm: int = 0) -> Sectors:
    sectors = Sectors()
    update_through(echoes, seen, RADIUS_MM)
    open_headings.measure(sectors, echoes, pose, seen, ease_mm, RADIUS_MM)
    return sectors


def closed(away_mm: int, body_mm: int) -> int:
    sectors = Sectors()
    sectors.count, sectors.away_mm[0], sectors.body_mm[0] = 1, away_mm, body_mm
    open_headings.close(sectors, sectors.tight, 0)
    return sectors.tight[0]


def half_of(away_mm: float, body_mm: float, slip: float) -> float:
    """Return half the closed sector by geometry, with the sine or cosine off by `slip`."""
    square = away_mm * away_mm - body_mm * body_mm
    if square <= LOOK_MM * LOOK_MM:
        return BRADS * asin(max(0.0, min(1.0, body_mm / away_mm + slip)))
    share = (square + LOOK_MM * LOOK_MM) / (2.0 * away_mm * LOOK_MM)
    return BRADS * acos(max(-1.0, min(1.0, share + slip)))


@given(st.integers(1, 300), st.integers(1, LOOK_MM - 1))
def test_half_sector_matches_geometry_within_a_table_step(body_mm: int, beyond_mm: int) -> None:
    away_mm = body_mm + beyond_mm
    half = closed(away_mm, body_mm)
    ends = [half_of(away_mm, body_mm, slip) for slip in (-1.0 / TABLE, 0.0, 1.0 / TABLE)]
    assert min(ends) - 1 <= half <= max(ends) + 2


@given(st.integers(20, 300), st.integers(1, LOOK_MM - 1), sides)
def test_disc_beside_the_sector_misses_the_point(body_mm: int, beyond_mm: int, side: int) -> None:
    away_mm = body_mm + beyond_mm
    turn_rad = side * closed(away_mm, body_mm) / BRADS
    along_mm = min(max(away_mm * cos(turn_rad), 0.0), LOOK_MM)
    miss_mm = hypot(away_mm * cos(turn_rad) - along_mm, away_mm * sin(turn_rad))
    assert miss_mm > body_mm - away_mm / TABLE - 1.0


def test_far_points_close_nothing_and_touching_ones_a_flank() -> None:
    assert closed(LOOK_MM + 100, 100) == 0
    assert closed(100, 100) == QUARTER
    assert closed(50, 100) == QUARTER
    assert closed(50, 0) == 0
    assert closed(50, -20) == 0


@given(st.integers(-400, 400), st.integers(-400, 400), st.integers(0, 30), st.integers(0, 30))
def test_a_wider_margin_closes_more(x_mm: int, y_mm: int, spread_mm: int, ease_mm: int) -> None:
    sectors = measured(points((x_mm, y_mm), spread_mm=spread_mm), ease_mm=ease_mm)
    open_headings.squeeze(sectors)
    assert SQUEEZE_MM < TIGHT_MM < WIDE_MM
    for k in range(sectors.count):
        assert 0 <= sectors.squeezed[k] <= sectors.tight[k] <= sectors.wide[k] <= QUARTER


def test_a_near_point_closes_the_headings_round_its_bearing() -> None:
    sectors = measured(points((200, 200)))
    assert sectors.count == 1
    eighth = CIRCLE // 8
    assert sectors.bearing[0] == pytest.approx(eighth, abs=1)
    assert sweeps.closer(sectors, eighth, sectors.tight) == 0
    assert sweeps.closer(sectors, -eighth, sectors.wide) == NOTHING


def test_bearings_are_those_of_the_odometry_frame() -> None:
    pose = Pose(1.0, 2.0, 2.2)
    sectors = measured(points((1000, 1750)), pose)
    assert sectors.bearing[0] == pytest.approx(-QUARTER, abs=1)


def test_unconfirmed_point_closes_nothing_but_slows_down() -> None:
    for x_mm in (RADIUS_MM + 20, RADIUS_MM + WARY_MM + 30):
        sectors = measured(points((x_mm, 0), weight=SURE - 1))
        assert sectors.count == 0
        assert sectors.free_mm == max(WARY_MM, x_mm - SLIM_MM)


@given(st.floats(-pi, pi), st.integers(RADIUS_MM + 5, 300), st.integers(-105, 105))
def test_the_way_ahead_is_free_up_to_a_small_distance(
    heading_rad: float, along_mm: int, aside_mm: int
) -> None:
    x_mm = along_mm * cos(heading_rad) - aside_mm * sin(heading_rad)
    y_mm = along_mm * sin(heading_rad) + aside_mm * cos(heading_rad)
    assume(hypot(x_mm, y_mm) < LOOK_MM + RADIUS_MM)
    sectors = measured(points((round(x_mm), round(y_mm))), Pose(0.0, 0.0, heading_rad))
    stop_mm = along_mm - sqrt((RADIUS_MM + TIGHT_MM) ** 2 - aside_mm**2)
    assert sectors.free_mm == pytest.approx(max(stop_mm, 0), abs=6)


@each("side", [1, -1])
def test_robot_keeps_clear_only_of_firm_points_aside(side: int) -> None:
    aside_mm = side * (RADIUS_MM + CLEAR_MM - 3)
    firm = measured(points((200, aside_mm), spread_mm=FIRM_MM))
    assert 100 < firm.free_mm < 200
    assert measured(points((200, aside_mm), spread_mm=FIRM_MM + 1)).free_mm == FREE_MM
    assert measured(points((200, aside_mm), weight=1)).free_mm == FREE_MM


def test_beside_and_behind_nothing_bounds_the_way_ahead() -> None:
    sectors = measured(points((0, 140), (0, -140), (-140, 0)))
    assert sectors.count == 3
    assert sectors.free_mm == FREE_MM


def test_spread_opens_headings_without_more_speed() -> None:
    sure, doubtful = measured(points((250, 0))), measured(points((250, 0), spread_mm=25))
    assert doubtful.tight[0] < sure.tight[0]
    assert doubtful.free_mm == sure.free_mm


def test_eased_margins_close_less() -> None:
    assert measured(points((250, 0)), ease_mm=20).tight[0] < measured(points((250, 0))).tight[0]


@given(st.integers(-80, 80), st.integers(-80, 80))
def test_points_within_the_robot_are_moved_out(x_mm: int, y_mm: int) -> None:
    """Points move to the rim, or just beyond it where whole millimetres make a direction coarse."""
    assume((x_mm, y_mm) != (0, 0))
    echoes = points((x_mm, y_mm))
    sectors = measured(echoes)
    away_mm = hypot(echoes.x_mm[0], echoes.y_mm[0])
    assert away_mm > RADIUS_MM - 3
    if hypot(x_mm, y_mm) > 30:
        assert away_mm == pytest.approx(RADIUS_MM, rel=0.04)
    assert sectors.away_mm[0] == RADIUS_MM
    assert sectors.tight[0] == QUARTER


def test_a_point_that_an_echo_passes_through_counts_less() -> None:
    echoes = points((RADIUS_MM + 150, 0), weight=SURE)
    pose = Pose(0.0, 0.0, -BEARINGS[3])
    assert measured(echoes, pose, ring({3: 2000})).count == 0
    assert echoes.weight[0] == SURE - 1


@each(("sonar", "weight"), [(2, 0), (3, 1)])
def test_longer_echoes_weaken_a_single_one_unless_it_is_ahead(sonar: int, weight: int) -> None:
    pose, seen = Pose(0.0, 0.0, -BEARINGS[sonar]), ring({sonar: 2000})
    echoes = points((RADIUS_MM + 100, 0), weight=1)
    assert not measured(echoes, pose, seen).count
    assert echoes.weight[0] == weight


def test_echo_before_a_point_does_not_weaken_it() -> None:
    echoes, pose = Echoes(), Pose(0.0, 0.0, -BEARINGS[3])
    for seen in [ring({3: 150})] * 4 + [ring({3: 2000})] * 20 + [ring({3: 150})] * 4:
        update_through(echoes, seen, RADIUS_MM)
        open_headings.measure(Sectors(), echoes, pose, seen, 0, RADIUS_MM)
        record(echoes, pose, pose, seen, RADIUS_MM)
    assert echoes.count == 1
    assert echoes.weight[0] >= SURE


def test_when_there_is_no_room_one_of_the_far_sectors_goes() -> None:
    crowd = [(200 + k, 0) for k in range(NEAR)]
    sectors = measured(points(*crowd, (150, 0)))
    assert sectors.count == NEAR
    kept = sectors.away_mm[:NEAR]
    assert min(kept) == 150
    gone = set(range(200, 200 + NEAR)) - set(kept)
    assert len(gone) == 1
    assert gone.pop() % FEW == 200 % FEW + FEW - 1  # the farthest of the compared sectors
    assert measured(points((150, 0), *crowd)).count == NEAR


def walker(at_rad: float, range_m: float, approach_m_s: float, across_m_s: float = 0.0) -> Ring:
    seen, pedestrians = ring({}), Ring().pedestrians
    pedestrians.any = True
    pedestrians.seen[0] = pedestrians.sure[0] = 1
    pedestrians.at_rad[0], pedestrians.range_m[0] = at_rad, range_m
    pedestrians.approach_m_s[0], pedestrians.across_m_s[0] = approach_m_s, across_m_s
    seen.pedestrians = pedestrians
    return seen


@each("at_rad", [-2.5, -1.0, 0.0, 0.7, 3.0])
def test_approaching_pedestrian_closes_headings(at_rad: float) -> None:
    sectors = measured(Echoes(), seen=walker(at_rad, 0.5, 0.1))
    assert sectors.count == 1
    assert sectors.point[0] == NOTHING
    assert sectors.bearing[0] == pytest.approx(BRADS * at_rad, abs=3)
    faster = measured(Echoes(), seen=walker(at_rad, 0.5, 0.2))
    assert sectors.tight[0] < sectors.wide[0] < faster.wide[0] < HALF_CIRCLE


@each("across_m_s", [0.15, -0.15])
def test_crossing_pedestrian_closes_its_future_place(across_m_s: float) -> None:
    """Crossing at 0.15 m/s, the pedestrian meets a robot of 0.3 m/s at 30 degrees."""
    sectors = measured(Echoes(), seen=walker(0.0, 1.0, 0.0, across_m_s))
    aside = 1.0 if across_m_s > 0.0 else -1.0
    assert sectors.bearing[0] == pytest.approx(aside * BRADS * pi / 6, rel=0.1)
    assert abs(sectors.bearing[0]) - sectors.tight[0] > 0


def test_unconfirmed_or_far_pedestrian_closes_nothing() -> None:
    unsure = walker(0.0, 0.5, 0.1)
    unsure.pedestrians.sure[0] = 0
    assert measured(Echoes(), seen=unsure).count == 0
    assert measured(Echoes(), seen=walker(0.0, 1.3, 0.1)).count == 0


def test_pedestrian_keeps_its_margin_in_a_gap() -> None:
    sectors = measured(Echoes(), seen=walker(0.0, 0.3, 0.1))
    squeeze(sectors)
    assert sectors.squeezed[0] == sectors.tight[0]


def test_pedestrian_counts_among_many_points() -> None:
    crowd = [(200 + k, 0) for k in range(NEAR)]
    sectors = measured(points(*crowd), seen=walker(1.0, 0.3, 0.1))
    assert sectors.count == NEAR
    assert sectors.point.count(NOTHING) == 1


anywhere = st.tuples(st.integers(-900, 900), st.integers(-900, 900))


walks = st.tuples(
    st.floats(-9.0, 9.0), st.floats(-1.0, 2.0), st.floats(-3.0, 3.0), st.floats(-0.3, 0.3)
)


@given(st.lists(anywhere, max_size=64), any_ranges, walks, st.floats(-pi, pi))
def test_any_points_and_echoes_give_at_most_so_many_sectors(
    places_mm: list[tuple[int, int]],
    range_m: Ranges,
    walk: tuple[float, float, float, float],
    heading_rad: float,
) -> None:
    seen = walker(*walk)
    seen.range_m = heard(range_m).range_m
    sectors = measured(points(*places_mm), Pose(0.0, 0.0, heading_rad), seen)
    assert 0 <= sectors.count <= NEAR
    assert 0 <= sectors.free_mm <= FREE_MM
    assert all(0 < sectors.wide[k] < HALF_CIRCLE for k in range(sectors.count))


BOTH = pytest.mark.parametrize("side", [1, -1])


def chain(*given: tuple[int, int]) -> Sectors:
    """Return sectors with these bearings and half widths; later ones are farther away."""
    sectors = Sectors()
    sectors.count = len(given)
    for k, (bearing, half) in enumerate(given):
        sectors.bearing[k], sectors.tight[k], sectors.away_mm[k] = bearing, half, 200 + k
    return sectors


def is_open(given: list[tuple[int, int]], heading: int) -> bool:
    offs = [((b - heading + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE, half) for b, half in given]
    return not any(-half < off < half for off, half in offs)


def smallest(given: list[tuple[int, int]], start: int, side: int) -> int:
    """Return the smallest turn, found by trying every heading."""
    return next((t for t in range(CIRCLE) if is_open(given, start + side * t)), CIRCLE)


# Some close nothing, most a part, few a whole flank, as for near points.
halves = st.one_of(st.integers(0, 300), st.integers(0, QUARTER))
bearings = st.integers(-2 * CIRCLE, 2 * CIRCLE)
sectors_given = st.lists(st.tuples(bearings, halves), max_size=NEAR)


def swept(sectors: Sectors, start: int, side: int) -> int:
    return sweeps.sweep(sectors, start, side, sectors.tight)


@given(sectors_given, bearings, sides)
def test_a_sweep_finds_the_smallest_open_rotation_on_either_side(
    given: list[tuple[int, int]], start: int, side: int
) -> None:
    assert swept(chain(*given), start, side) == smallest(given, start, side)


@given(sectors_given, bearings)
def test_closed_steps_are_those_that_a_sector_closes(
    given: list[tuple[int, int]], start: int
) -> None:
    sectors = chain(*given)
    found = sweeps.closed_steps(sectors, start, sectors.tight)
    headings = [start + k * sweeps.STEP for k in range(sweeps.STEPS)]
    closing = [sweeps.closer(sectors, heading, sectors.tight) for heading in headings]
    assert [found >> k & 1 for k in range(sweeps.STEPS)] == [k != NOTHING for k in closing]


@given(sectors_given, bearings, sides, st.integers(0, HALF_CIRCLE), st.integers(1, HALF_CIRCLE))
def test_sweep_with_limits_finds_the_next_open_heading(
    given: list[tuple[int, int]], start: int, side: int, turn: int, more: int
) -> None:
    sectors = chain(*given)
    sweeps.aim(sectors, start, side)
    found = sweeps.open_from(sectors, sectors.tight, turn, turn + more)
    right = turn + smallest(given, start + side * turn, side)
    assert found == (right if right <= turn + more else CIRCLE)


@given(sectors_given, bearings, sides)
def test_what_closes_the_heading_before_the_open_one_is_known(
    given: list[tuple[int, int]], start: int, side: int
) -> None:
    sectors = chain(*given)
    turn = swept(sectors, start, side)
    assume(turn < CIRCLE)
    if turn == 0:
        assert sectors.closing == NOTHING
    else:
        assert not is_open([given[sectors.closing]], start + side * (turn - 1))


@BOTH
@pytest.mark.parametrize("order", [1, -1])
def test_a_chain_is_swept_to_its_end_to_and_fro(side: int, order: int) -> None:
    row = [(side * 100 * k, 80) for k in range(NEAR)][::order]
    sectors = chain(*row)
    assert swept(sectors, 0, side) == 100 * (NEAR - 1) + 80
    last = row.index((side * 100 * (NEAR - 1), 80))
    assert sectors.closing == last


@BOTH
def test_where_everything_is_closed_a_sweep_finds_no_end(side: int) -> None:
    sectors = chain(*[(k * 512, 300) for k in range(8)])
    assert swept(sectors, 77, side) == CIRCLE


def test_an_open_heading_is_not_turned_and_nothing_closes_it() -> None:
    sectors = chain((500, 200))
    assert swept(sectors, 0, 1) == 0
    assert sectors.closing == NOTHING


@given(sectors_given, bearings, sides)
def test_room_is_how_far_it_stays_open_beyond(
    given: list[tuple[int, int]], start: int, side: int
) -> None:
    sectors = chain(*given)
    turn = swept(sectors, start, side)
    assume(turn < CIRCLE)
    room = sweeps.room(sectors, turn, sectors.tight)
    assert all(is_open(given, start + side * (turn + k)) for k in range(room + 1))
    assert room == HALF_CIRCLE or not is_open(given, start + side * (turn + room + 1))


@given(sectors_given, bearings)
def test_the_nearest_of_those_that_close_a_heading_is_found(
    given: list[tuple[int, int]], heading: int
) -> None:
    sectors = chain(*given)
    closing = [k for k, sector in enumerate(given) if not is_open([sector], heading)]
    assert sweeps.closer(sectors, heading, sectors.tight) == min(closing, default=NOTHING)
