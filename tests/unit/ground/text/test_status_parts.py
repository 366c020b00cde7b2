"""A line that fits: short forms first, then the last parts are dropped; old values are marked."""

from hypothesis import given
from hypothesis import strategies as st

from ground.text.status_parts import Part, Piece, fitted, in_words

LINE = (Part("driving"), Part("3.25 m to go", "3.25 m"), Part(""), Part("echo 0.50 m", "echo 0.50"))


def plain(width: int) -> str:
    return words_of(fitted(LINE, width, dims=True))


def words_of(pieces: list[Piece]) -> str:
    return "".join(piece.text for piece in pieces)


def test_wide_line_shows_everything() -> None:
    assert plain(80) == "driving  3.25 m to go  echo 0.50 m" == in_words(LINE)


def test_narrow_line_uses_short_forms() -> None:
    assert plain(33) == "driving 3.25 m echo 0.50"
    assert plain(24) == "driving 3.25 m echo 0.50"


def test_with_little_room_the_last_parts_go_and_then_it_is_cut() -> None:
    assert plain(23) == "driving 3.25 m"
    assert plain(13) == "driving"
    assert plain(3) == "dri"


def test_an_old_part_is_dimmed_and_takes_no_more_room() -> None:
    pieces = fitted((Part("a"), Part("bc", age_s=0.25)), 80, dims=True)
    assert pieces == [Piece("a"), Piece("  "), Piece("bc", dim=True)]


def test_without_dimming_the_age_is_shown() -> None:
    old = (Part("a"), Part("bc", age_s=0.25))
    assert in_words(old) == "a  bc (0.2 s)"
    assert words_of(fitted(old, 80, dims=False)) == "a  bc (0.2 s)"


def test_a_short_form_that_cannot_be_dimmed_has_its_age_too() -> None:
    old = (Part("a"), Part("long words", "bc", age_s=0.25))
    assert words_of(fitted(old, 12, dims=False)) == "a bc (0.2 s)"
    assert words_of(fitted(old, 11, dims=False)) == "a"


@given(
    st.lists(
        st.builds(
            Part,
            st.text("abc", max_size=9),
            st.text("abc", max_size=5),
            st.none() | st.floats(0.0, 9.0),
        ),
        max_size=6,
    ),
    st.integers(1, 60),
    st.booleans(),
)
def test_no_line_is_wider_than_its_terminal(parts: list[Part], width: int, dims: bool) -> None:
    assert len(words_of(fitted(parts, width, dims=dims))) <= width
