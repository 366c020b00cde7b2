"""Test dots, lines and text in character cells."""

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from ground.map.canvas import DOTS, Canvas
from tests.support.each import each

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
