"""The canvas of the map: dots and characters, marks and curves in metres, and its views."""

from itertools import pairwise
from math import hypot, inf, isfinite, nan, pi
from unicodedata import east_asian_width

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ground.map.canvas import DOTS, HEADINGS, MARKS, POINTERS, Canvas, ascii_art, braille, stroke
from ground.map.drawing import MARKED_OUTCOMES
from ground.map.pen import Pen
from ground.map.scene import MAX_M_PER_DOT, MIN_M_PER_DOT, Box, View
from protocol.outcome import OUTCOMES
from tests.support.each import each

EVERY = bytes(range(256))


def bits(*dots: tuple[int, int]) -> int:
    return sum(DOTS[2 * y + x] for x, y in dots)


def test_each_pattern_has_its_braille_character() -> None:
    assert len(set(braille(EVERY))) == len(braille(EVERY)) == 256
    assert braille(EVERY)[0] == " "
    assert braille(EVERY)[bits((0, 0), (0, 1), (0, 2), (0, 3))] == "⡇"
    assert braille(EVERY)[255] == "⣿"


@each(
    ("character", "dots"),
    [
        (" ", ()),
        ("-", ((0, 0), (1, 0))),
        ("-", ((0, 2), (1, 2))),
        ("_", ((0, 3), (1, 3))),
        ("|", ((0, 0), (0, 1), (0, 2), (0, 3))),
        ("|", ((1, 2), (1, 3))),
        ("/", ((0, 3), (0, 2), (1, 1), (1, 0))),
        ("\\", ((0, 0), (0, 1), (1, 2), (1, 3))),
        ("'", ((0, 0),)),
        (".", ((1, 3),)),
        ("+", ((0, 0), (0, 1), (0, 2), (0, 3), (1, 1))),
        ("#", tuple((x, y) for x in range(2) for y in range(4))),
    ],
)
def test_stroke_resembles_its_dots(character: str, dots: tuple[tuple[int, int], ...]) -> None:
    assert stroke(bits(*dots)) == character


def test_mirrored_patterns_have_mirrored_strokes() -> None:
    mirrored = {"/": "\\", "\\": "/"}
    for pattern in range(256):
        dots = [(at % 2, at // 2) for at, bit in enumerate(DOTS) if pattern & bit]
        mirror = bits(*((1 - x, y) for x, y in dots))
        drawn = ascii_art(EVERY)[pattern]
        assert ascii_art(EVERY)[mirror] == mirrored.get(drawn, drawn)


def test_cell_with_a_dot_is_never_blank() -> None:
    for table in (braille(EVERY), ascii_art(EVERY)):
        assert all(character.strip() for character in table[1:])
    assert "".join(ascii_art(EVERY)).isascii()


def test_marks_take_one_cell_also_in_ascii() -> None:
    for rich, plain in (
        *MARKS.values(),
        *zip(*HEADINGS, strict=True),
        *zip(*POINTERS, strict=True),
    ):
        assert len(rich) == len(plain) == 1
        assert east_asian_width(rich) not in "WF"
        assert plain.isascii()
        assert plain.isprintable()


def test_headings_and_pointers_differ() -> None:
    assert not set(HEADINGS[0]) & set(POINTERS[0])


def test_each_outcome_of_a_claim_has_its_own_mark() -> None:
    marks = [MARKS[name] for name in MARKED_OUTCOMES.values()]
    assert {"unreachable", "lost", "stuck"} <= set(MARKED_OUTCOMES) <= set(OUTCOMES)
    assert len({rich for rich, _ in marks}) == len({plain for _, plain in marks}) == len(marks)


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


NUMBERS = st.integers(-40, 60)
FAR = st.integers(-(10**12), 10**12)


def dots_of(canvas: Canvas) -> set[tuple[int, int]]:
    """Return the dots as read from the braille text."""
    found = set()
    for row, text in enumerate(canvas.to_rows()):
        for column, character in enumerate(text):
            bits = 0 if character == " " else ord(character) - 0x2800
            for at, bit in enumerate(DOTS):
                if bits & bit:
                    found.add((2 * column + at % 2, 4 * row + at // 2))
    return found


def line_dots(
    x0: int, y0: int, x1: int, y1: int, columns: int = 10, rows: int = 5
) -> set[tuple[int, int]]:
    canvas = Canvas(columns, rows)
    canvas.line(x0, y0, x1, y1, "wall")
    return dots_of(canvas)


def test_each_dot_has_its_place_in_the_character() -> None:
    for x in range(2):
        for y in range(4):
            canvas = Canvas(1, 1)
            canvas.dots([(x, y)], "wall")
            assert dots_of(canvas) == {(x, y)}


def test_canvas_becomes_braille_text() -> None:
    canvas = Canvas(8, 3)
    canvas.line(0, 0, 15, 0, "wall")
    canvas.line(0, 0, 0, 11, "wall")
    canvas.line(0, 11, 15, 0, "trail")
    assert canvas.to_rows() == [
        "⡏⠉⠉⠉⠉⢉⠝⠋",
        "⡇ ⢀⡠⠊⠁  ",
        "⡧⠔⠁     ",
    ]


def test_canvas_becomes_ascii_text() -> None:
    canvas = Canvas(8, 3, ascii_only=True)
    canvas.line(0, 1, 15, 1, "wall")
    canvas.line(0, 0, 0, 11, "wall")
    canvas.line(0, 11, 15, 0, "trail")
    assert canvas.to_rows() == [
        "+----\\//",
        "| .//'  ",
        "+/'     ",
    ]


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS)
@settings(deadline=None)
def test_a_line_sets_the_same_dots_from_either_end(x0: int, y0: int, x1: int, y1: int) -> None:
    assert line_dots(x0, y0, x1, y1) == line_dots(x1, y1, x0, y0)


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS)
@settings(deadline=None)
def test_clipped_line_equals_the_visible_part(x0: int, y0: int, x1: int, y1: int) -> None:
    shift = 40
    ends = (x0 + shift, y0 + shift, x1 + shift, y1 + shift)
    whole = {(x - shift, y - shift) for x, y in line_dots(*ends, columns=60, rows=30)}
    assert line_dots(x0, y0, x1, y1) == {(x, y) for x, y in whole if 0 <= x < 20 and 0 <= y < 20}


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS)
@settings(deadline=None)
def test_line_is_connected_and_one_dot_wide(x0: int, y0: int, x1: int, y1: int) -> None:
    shift = 40
    ends = (x0 + shift, y0 + shift, x1 + shift, y1 + shift)
    dots = line_dots(*ends, columns=60, rows=30)
    assert len(dots) == max(abs(x1 - x0), abs(y1 - y0)) + 1
    assert {ends[:2], ends[2:]} <= dots


@given(FAR, FAR, FAR, FAR)
@settings(deadline=None)
def test_distant_ends_are_clipped(x0: int, y0: int, x1: int, y1: int) -> None:
    assert len(line_dots(x0, y0, x1, y1)) <= 20


@given(st.lists(st.tuples(NUMBERS, NUMBERS), max_size=12))
@settings(deadline=None)
def test_polyline_equals_its_lines(points: list[tuple[int, int]]) -> None:
    canvas, other = Canvas(10, 5), Canvas(10, 5)
    canvas.polyline(points, "trail")
    other.dots(points, "trail")
    for a, b in pairwise(points):
        other.line(*a, *b, "trail")
    assert canvas.to_rows() == other.to_rows()


def test_the_role_drawn_last_has_the_cell() -> None:
    canvas = Canvas(2, 1)
    canvas.line(0, 0, 3, 0, "wall")
    canvas.dots([(3, 3)], "robot")
    assert canvas.strip(0) == [("wall", "⠉"), ("robot", "⢉")]


def test_blank_cells_belong_to_the_run_before_them() -> None:
    canvas = Canvas(5, 2)
    canvas.dots([(2, 0), (8, 0)], "wall")
    assert canvas.strip(0) == [("wall", " ⠁  ⠁")]
    assert canvas.strip(1) == [("", "     ")]


def test_text_covers_dots_drawn_later() -> None:
    canvas = Canvas(4, 1)
    canvas.text(0, 0, "ab", "goal")
    canvas.line(0, 0, 7, 0, "robot")
    assert canvas.strip(0) == [("goal", "ab"), ("robot", "⠉⠉")]


def test_text_is_moved_onto_the_canvas_or_cut() -> None:
    canvas = Canvas(6, 2)
    canvas.text(4, 0, "goal", "text")
    canvas.text(3, 1, "simulation", "text")
    assert canvas.to_rows() == ["  goal", "simula"]


@each("name", ["a\x1b[31m", "日本", "e\u0301", "a\nb", "\u202etxt"])
def test_received_name_takes_one_cell_per_character(name: str) -> None:
    canvas = Canvas(10, 1)
    canvas.text(0, 0, name, "text")
    assert len(canvas.to_rows()[0]) == 10
    assert canvas.to_rows()[0].isprintable()
    assert "?" in canvas.to_rows()[0]


def test_ascii_canvas_has_ascii_only() -> None:
    canvas = Canvas(12, 1, ascii_only=True)
    canvas.mark(0, 0, "goal", "goal")
    canvas.heading(2, 0, 2, "robot")
    canvas.text(4, 0, "é·a", "text")
    assert canvas.to_rows() == ["O ^ ??a     "]


def test_canvas_without_cells_accepts_any_drawing() -> None:
    for columns, rows in ((0, 0), (-3, 4), (5, 0)):
        canvas = Canvas(columns, rows)
        canvas.line(0, 0, 9, 9, "wall")
        canvas.text(0, 0, "goal", "text")
        canvas.mark(0, 0, "goal", "goal")
        assert "".join(canvas.to_rows()).strip() == ""
        assert canvas.strip(0) == [("", " " * 5)] * bool(canvas.columns)


def test_only_rows_that_differ_are_changed() -> None:
    canvas = Canvas(6, 4)
    canvas.line(0, 0, 11, 0, "wall")
    twin = canvas.copy()
    assert canvas.changed_rows(twin) == []
    twin.dots([(0, 5)], "wall")
    twin.text(0, 2, "x", "text")
    twin.line(0, 0, 0, 0, "robot")
    assert canvas.changed_rows(twin) == [0, 1, 2]
    assert canvas.to_rows()[1].strip() == ""


SIZES = st.integers(0, 400)
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
