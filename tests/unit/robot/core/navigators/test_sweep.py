import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from robot.core.navigators import open_headings as sweeps
from robot.core.navigators.open_headings import NEAR, Sectors
from robot.core.perception.echoes import CIRCLE, HALF_CIRCLE, NOTHING, QUARTER

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
sides = st.sampled_from([1, -1])


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
