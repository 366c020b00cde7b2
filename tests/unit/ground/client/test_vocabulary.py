"""Values of parameters are shown and typed by name."""

import pytest

from ground.client.vocabulary import value_in_words, value_words
from runtime.errors import UserError


@pytest.mark.parametrize(
    ("parameter", "words", "value"),
    [("navigator", "bug", 1), ("navigator", "vgm_memory", 6), ("side", "left", 1),
     ("side", "right", -1), ("d_obs_m", "0.35", 0.35)],
)  # fmt: skip
def test_value_is_shown_and_typed_by_its_name(parameter: str, words: str, value: float) -> None:
    assert value_words(parameter, value) == words
    assert value_in_words(parameter, words) == value


@pytest.mark.parametrize(("words", "value"), [("1", 1.0), ("BUG", 1.0), ("-1e0", -1.0)])
def test_number_and_any_case_are_accepted(words: str, value: float) -> None:
    assert value_in_words("navigator", words) == value


def test_value_without_a_name_is_a_number() -> None:
    assert value_words("navigator", 99) == "99"
    assert value_words("d_obs_m", 0.1 + 0.2) == "0.3"


@pytest.mark.parametrize("words", ["", "nan", "inf", "-inf", "buggy", "1,5"])
def test_word_that_is_no_value_is_an_error(words: str) -> None:
    with pytest.raises(UserError, match="must be a finite number or one of bug, vgm"):
        value_in_words("navigator", words)
    with pytest.raises(UserError, match=r"must be a finite number$"):
        value_in_words("d_obs_m", words)
