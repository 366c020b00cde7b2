"""Test how the Drive screen is shared, above all that square worlds fill the map."""

from ground.app.screens.drive import LEAST_MAP, drive_layout
from ground.map.canvas import DOTS_HIGH, DOTS_WIDE
from ground.map.view import View
from tests.support.each import each

CONTENT = ((80, 20), (120, 36), (200, 56))
"""Columns and rows between tabs and command line at 80x24, 120x40 and 200x60."""


def empty_share(columns: int, rows: int, floor_m: tuple[float, float]) -> float:
    """Return the share of the map, legend excluded, that the floor does not cover."""
    layout = drive_layout(columns, rows, floor_m)
    map_rows = rows if layout.beside else rows - layout.lower_rows
    view = View.fit((0.0, 0.0, *floor_m), layout.map_columns, map_rows)
    floor_dots = floor_m[0] * floor_m[1] / view.m_per_dot**2
    return 1.0 - floor_dots / (DOTS_WIDE * layout.map_columns * DOTS_HIGH * (map_rows - 1))


@each(("columns", "rows"), CONTENT)
@each("floor_m", [(6.0, 6.0), (7.0, 7.0), (6.0, 5.0), (5.0, 4.0)])
def test_square_worlds_leave_little_of_the_map_empty(
    columns: int, rows: int, floor_m: tuple[float, float]
) -> None:
    assert empty_share(columns, rows, floor_m) < 0.3


@each(("columns", "rows"), CONTENT)
def test_log_is_beside_the_map_where_there_is_room(columns: int, rows: int) -> None:
    assert drive_layout(columns, rows, (7.0, 7.0)).beside == (columns >= 120)


@each("floor_m", [None, (0.0, 4.0), (40.0, 1.0), (1.0, 40.0)])
@each("columns", [1, 60, 80, 120, 300])
@each("rows", [1, 14, 20, 36, 90])
@each("explaining", [False, True])
def test_any_size_has_a_layout(
    columns: int, rows: int, floor_m: tuple[float, float] | None, explaining: bool
) -> None:
    layout = drive_layout(columns, rows, floor_m, explaining=explaining)
    assert layout.map_columns >= LEAST_MAP
    assert layout.lower_rows >= (11 if explaining else 4)
