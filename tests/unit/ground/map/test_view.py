"""Test views of the map with any numbers."""

from math import inf, isfinite, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ground.map.view import MAX_M_PER_DOT, MIN_M_PER_DOT, Box, View

SIZES = st.integers(0, 400)
ANY = st.floats(allow_nan=True, allow_infinity=True)
PLACES = st.floats(-1e4, 1e4)
VIEWS = st.builds(View, SIZES, SIZES, PLACES, PLACES, st.floats(1e-3, 1e3))


def usable(view: View) -> bool:
    numbers = (view.centre_x_m, view.centre_y_m, view.m_per_dot)
    return all(map(isfinite, numbers)) and MIN_M_PER_DOT <= view.m_per_dot <= MAX_M_PER_DOT


@given(VIEWS, PLACES, PLACES)
@settings(deadline=None)
def test_dots_and_metres_are_inverse(view: View, x_m: float, y_m: float) -> None:
    back = view.to_metres(*view.to_dots(x_m, y_m))
    assert back == pytest.approx((x_m, y_m), abs=1e-6 * max(1.0, view.m_per_dot))


@given(VIEWS, ANY, ANY, ANY)
@settings(deadline=None)
def test_any_numbers_give_a_usable_view(view: View, a: float, b: float, c: float) -> None:
    assert usable(view.zoomed(a, (b, c)))
    assert usable(view.centred(a, b))
    assert usable(view.following(a, b))
    assert usable(View.fit((a, b, c, a), view.columns, view.rows))


@given(st.tuples(PLACES, PLACES), st.floats(0.1, 1e3), st.floats(0.1, 1e3))
@settings(deadline=None)
def test_fitted_box_is_on_the_map(low: tuple[float, float], wide: float, high: float) -> None:
    box: Box = (*low, low[0] + wide, low[1] + high)
    view = View.fit(box, 80, 24)
    assert view.shows(box)
    assert View.fit(box, 80, 24, bounded=False).m_per_dot > view.m_per_dot


def test_unbounded_box_has_open_floor_around_it() -> None:
    robot = (2.9, 0.9, 3.1, 1.1)
    view = View.fit(robot, 80, 24, bounded=False)
    left_m, low_m, right_m, top_m = view.box()
    assert min(right_m - left_m, top_m - low_m) > 4.0
    assert view.to_metres(80.0, 46.0) == pytest.approx((3.0, 1.0), abs=0.05)


def test_box_beyond_any_side_is_not_shown() -> None:
    view = View(80, 24, 0.0, 0.0, 0.05)
    left_m, low_m, right_m, top_m = view.box()
    assert view.shows(view.box())
    assert not view.shows((left_m - 1.0, low_m, right_m, top_m))
    assert not view.shows((left_m, low_m - 1.0, right_m, top_m))
    assert not view.shows((left_m, low_m, right_m + 1.0, top_m))
    assert not view.shows((left_m, low_m, right_m, top_m + 1.0))


def test_point_or_missing_box_can_be_fitted() -> None:
    assert usable(View.fit(None, 80, 24))
    assert usable(View.fit((3.0, 3.0, 3.0, 3.0), 1, 1))
    assert View.fit((3.0, 4.0, 3.0, 4.0), 80, 5).middle() == (3.0, 4.0)


@given(VIEWS, PLACES, PLACES, st.floats(0.5, 2.0))
@settings(deadline=None)
def test_zooming_keeps_the_place_zoomed_about(
    view: View, x_m: float, y_m: float, factor: float
) -> None:
    zoomed = view.zoomed(factor, (x_m, y_m))
    before, after = view.to_dots(x_m, y_m), zoomed.to_dots(x_m, y_m)
    assert after == pytest.approx(before, rel=1e-6, abs=1e-3)


def test_zooming_stops_at_the_ends() -> None:
    view = View(80, 24)
    for _ in range(300):
        view = view.zoomed(2.0)
    assert view.m_per_dot == MIN_M_PER_DOT
    for _ in range(300):
        view = view.zoomed(0.5)
    assert view.m_per_dot == MAX_M_PER_DOT


def test_following_moves_the_map_only_near_the_edge() -> None:
    view = View(80, 24, 0.0, 0.0, 0.05)
    assert view.following(1.5, 0.0) == view
    assert view.following(2.5, 0.0).middle() == (2.5, 0.0)
    assert view.following(0.0, -1.5).middle() == (0.0, -1.5)


def test_place_and_cell_correspond() -> None:
    view = View(80, 24, 2.0, 1.0, 0.05)
    assert view.cell_of(2.0, 1.0) == (40, 12)
    assert view.cell_of(*view.middle_of(7, 3)) == (7, 3)
    assert view.cell_of(-50.0, 1.0) == (-480, 12)
    assert view.cell_of(nan, 1.0) is None
    assert view.cell_of(inf, 1.0) is None


@given(VIEWS, st.integers(1, 60))
@settings(deadline=None)
def test_the_scale_bar_is_round_and_fits(view: View, cells: int) -> None:
    length_m, taken = view.scale_bar(cells)
    assert f"{length_m:.0e}"[0] in "125"
    assert 1 <= taken <= cells
    assert length_m <= cells * 2 * view.m_per_dot * (1 + 1e-6)


def test_a_resized_view_keeps_its_middle_and_scale() -> None:
    view = View(80, 24, 2.0, 1.0, 0.05).resized(1, 1)
    assert (view.columns, view.rows, view.middle()) == (1, 1, (2.0, 1.0))
