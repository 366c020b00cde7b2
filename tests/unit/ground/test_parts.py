"""A line that fits: short forms first, then the last parts go; old is seen to be old."""

from hypothesis import given
from hypothesis import strategies as st

from ground.parts import DIM, PLAIN, Part, fitted, in_words

LINE = (Part("driving"), Part("3.25 m to go", "3.25 m"), Part(""), Part("echo 0.50 m", "echo 0.50"))


def plain(width: int) -> str:
    return fitted(LINE, width, dims=True)[0]


def test_with_room_everything_is_said_in_full() -> None:
    assert plain(80) == "driving  3.25 m to go  echo 0.50 m" == in_words(LINE)


def test_with_less_room_it_is_said_shorter() -> None:
    assert plain(33) == "driving 3.25 m echo 0.50"
    assert plain(24) == "driving 3.25 m echo 0.50"


def test_with_little_room_the_last_parts_go_and_then_it_is_cut() -> None:
    assert plain(23) == "driving 3.25 m"
    assert plain(13) == "driving"
    assert plain(3) == "dri"


def test_an_old_part_is_dimmed_and_takes_no_more_room() -> None:
    text, length = fitted((Part("a"), Part("bc", age_s=0.25)), 80, dims=True)
    assert text == f"a  {DIM}bc{PLAIN}"
    assert length == 5


def test_where_nothing_can_be_dimmed_its_age_is_said() -> None:
    old = (Part("a"), Part("bc", age_s=0.25))
    assert in_words(old) == "a  bc (0.2 s)"
    assert fitted(old, 80, dims=False) == ("a  bc (0.2 s)", 13)


def test_a_short_form_that_cannot_be_dimmed_has_its_age_too() -> None:
    old = (Part("a"), Part("long words", "bc", age_s=0.25))
    assert fitted(old, 12, dims=False)[0] == "a bc (0.2 s)"
    assert fitted(old, 11, dims=False)[0] == "a"


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
    text, length = fitted(parts, width, dims=dims)
    assert length == len(text.replace(DIM, "").replace(PLAIN, "")) <= width
