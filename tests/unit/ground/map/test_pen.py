"""Test marks, labels and curves drawn in metres."""

from math import hypot, inf, nan, pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ground.map.canvas import Canvas
from ground.map.pen import Pen
from ground.map.view import View
from tests.support.each import each

ANY = st.floats(allow_nan=True, allow_infinity=True)


def pen(columns: int = 20, rows: int = 5) -> Pen:
    """Return a pen with 0 0 in the middle and cells of 0.2 m x 0.4 m."""
    return Pen(Canvas(columns, rows), View(columns, rows, 0.0, 0.0, 0.1))


def rows(drawn: Pen) -> list[str]:
    return [row.rstrip() for row in drawn.canvas.to_rows()]


def test_label_is_to_the_right_of_its_mark() -> None:
    drawn = pen()
    drawn.mark((0.05, 0.0), "goal", "goal", "goal")
    assert rows(drawn)[2] == "          ◎ goal"


def test_labels_do_not_cover_each_other() -> None:
    drawn = pen()
    drawn.mark((0.05, 0.0), "goal", "goal", "one")
    drawn.mark((0.05, 0.0), "goal", "goal", "two")
    drawn.mark((0.05, 0.0), "goal", "goal", "red")
    assert rows(drawn)[2:4] == ["      two ◎ one", "          red"]


def test_label_at_the_right_edge_is_on_the_left() -> None:
    drawn = pen()
    drawn.mark((1.9, 0.0), "goal", "goal", "goal")
    assert rows(drawn)[2] == "              goal ◎"


def test_label_can_be_requested_on_the_left() -> None:
    drawn = pen()
    drawn.mark((0.05, 0.0), "goal", "goal", "goal", to_left=True)
    assert rows(drawn)[2] == "     goal ◎"


def test_mark_off_the_map_has_no_label() -> None:
    drawn = pen()
    drawn.mark((9.0, 0.0), "goal", "goal", "goal")
    drawn.mark((nan, 0.0), "goal", "goal", "goal")
    assert "".join(rows(drawn)) == ""


@each(
    ("at", "arrow"),
    [
        ((9.0, 0.0), "→"),
        ((9.0, 9.0), "↗"),
        ((0.0, 9.0), "↑"),
        ((-9.0, 0.0), "←"),
        ((-9.0, -9.0), "↙"),
        ((0.0, -9.0), "↓"),
    ],
)
def test_a_pointer_shows_the_way_out_of_the_map(at: tuple[float, float], arrow: str) -> None:
    drawn = pen()
    drawn.off_map(at, "goal", "goal")
    text = "".join(rows(drawn))
    assert arrow in text
    assert "goal" in text


def test_only_finite_places_off_the_map_have_a_pointer() -> None:
    drawn = pen()
    for at in ((0.0, 0.0), (1.9, -0.9), (nan, 0.0), (inf, 0.0)):
        drawn.off_map(at, "goal", "goal")
    assert "".join(rows(drawn)) == ""


@given(ANY, ANY)
@settings(deadline=None)
def test_a_pointer_is_always_on_the_map(x_m: float, y_m: float) -> None:
    drawn = pen()
    drawn.off_map((x_m, y_m), "goal", "")
    marks = sum(character in "→↗↑↖←↙↓↘" for character in "".join(rows(drawn)))
    at = drawn.view.to_dots(x_m, y_m)
    nowhere = not all(-inf < value < inf for value in at)
    assert marks == (0 if nowhere or drawn.shows((x_m, y_m)) else 1)


@each(
    ("heading_rad", "arrow"),
    [(0.0, "▶"), (pi / 4.0, "◥"), (pi / 2.0, "▲"), (pi, "◀"), (-pi / 2.0, "▼"), (40.0 * pi, "▶")],
)
def test_a_heading_is_the_nearest_of_eight(heading_rad: float, arrow: str) -> None:
    drawn = pen()
    drawn.heading((0.0, 0.0), heading_rad + 0.1, "robot")
    assert "".join(rows(drawn)).strip() == arrow


def test_heading_that_is_not_finite_is_not_drawn() -> None:
    drawn = pen()
    drawn.heading((0.0, 0.0), nan, "robot")
    drawn.heading((0.0, 0.0), inf, "robot")
    assert "".join(rows(drawn)) == ""


@given(st.floats(0.01, 50.0), st.floats(-pi, pi), st.floats(0.0, 2.0 * pi))
@settings(deadline=None)
def test_a_curve_keeps_to_its_radius(radius_m: float, begun_rad: float, turn_rad: float) -> None:
    ends_rad = begun_rad, begun_rad + turn_rad
    points = pen().curve((1.0, 2.0), radius_m, radius_m, ends_rad=ends_rad)
    assert points
    for x_m, y_m in points:
        assert hypot(x_m - 1.0, y_m - 2.0) == pytest.approx(radius_m)


def test_number_of_chords_follows_the_scale() -> None:
    small, large = (len(pen().curve((0.0, 0.0), r, r)) for r in (0.1, 2.0))
    assert small < large < 100
    assert len(pen().curve((0.0, 0.0), 1e6, 1e6)) <= 241
    assert pen().curve((0.0, 0.0), nan, 1.0) == ()
    assert pen().curve((0.0, 0.0), -1.0, 1.0) == ()


def test_dotted_line_has_dots_at_its_ends() -> None:
    drawn = pen()
    drawn.dotted((-1.5, 0.0), (1.5, 0.0), "virtual", 10)
    assert rows(drawn)[2] == "  ⠠    ⠠    ⠠    ⠠"


def test_a_circle_is_closed() -> None:
    drawn = pen(10, 5)
    drawn.circle((0.0, 0.0), 0.6, "zone")
    assert rows(drawn) == ["", "  ⢠⠊⠉⠉⠒⢄", "  ⡇    ⠈⡆", "  ⠘⢄⣀⣀⠤⠊", ""]


def test_disc_is_solid_and_needs_a_finite_size() -> None:
    drawn = pen(10, 5)
    drawn.disc((0.0, 0.0), 0.4, "robot")
    assert rows(drawn) == ["", "    ⣀⣄⡀", "   ⢼⣿⣿⣿⠄", "   ⠈⠛⠟⠋", ""]
    for radius_m in (nan, inf, -1.0):
        blank = pen(10, 5)
        blank.disc((0.0, 0.0), radius_m, "robot")
        blank.disc((nan, 0.0), 0.4, "robot")
        assert "".join(rows(blank)) == ""
