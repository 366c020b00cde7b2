"""Test the characters for dots and marks."""

from unicodedata import east_asian_width

from ground.map.canvas import DOTS, HEADINGS, MARKS, POINTERS, ascii_art, braille, stroke
from ground.map.drawing import MARKED_OUTCOMES
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
