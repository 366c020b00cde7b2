"""A typed line is split into words: quotes as in a shell, printable characters only."""

import shlex

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.console.parser import MAX_LENGTH, last_word, words_of
from runtime.errors import UserError
from tests.support.each import each

shown = st.text(st.characters(exclude_categories=("C", "Z")) | st.just(" "), max_size=20)


@each(
    ("text", "words"),
    [
        ("goal 1 2", ["goal", "1", "2"]),
        ("  :goal\t1   2 ", ["goal", "1", "2"]),
        ("snap 'a b.svg'", ["snap", "a b.svg"]),
        ('mark "it\'s here"', ["mark", "it's here"]),
        (r"snap a\ b", ["snap", "a b"]),
        ("", []),
        (":", []),
    ],
)
def test_words_are_parted_as_in_a_shell(text: str, words: list[str]) -> None:
    assert words_of(text) == words


@given(st.lists(shown, min_size=1, max_size=5))
def test_whatever_is_quoted_comes_back(words: list[str]) -> None:
    assert words_of(shlex.join(["mark", *words])) == ["mark", *words]


@each("odd", ["\x00", "\x1b[31m", "\x7f", "\u202e", "\u2028", "\ud800", "\r"])
def test_what_cannot_be_seen_is_named_and_refused(odd: str) -> None:
    with pytest.raises(UserError, match="cannot be part of a command"):
        words_of(f"mark a{odd}b")


def test_a_paste_is_refused_by_its_length_before_anything_else() -> None:
    with pytest.raises(UserError, match=f"at most {MAX_LENGTH}"):
        words_of("\x00" * 10_000)


@each(
    ("text", "before", "begun"),
    [
        ("", [], ""),
        ("go", [], "go"),
        ("goal ", ["goal"], ""),
        ("goal 1", ["goal"], "1"),
        ("snap 'a b", ["snap"], "a b"),
        ('snap "a b', ["snap"], "a b"),
        ("snap 'a b' ", ["snap", "a b"], ""),
    ],
)
def test_last_word_is_split_from_those_before(text: str, before: list[str], begun: str) -> None:
    assert last_word(text) == (before, begun)


@given(st.text())
def test_any_text_has_a_last_word(text: str) -> None:
    before, begun = last_word(text)
    assert isinstance(begun, str)
    assert all(isinstance(word, str) for word in before)
