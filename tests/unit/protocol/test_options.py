"""Negative numbers on a command line are numbers, however they are written."""

import argparse

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.options import numbers_kept


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("x", type=float)
    parser.add_argument("--goal", type=float, nargs="+")
    parser.add_argument("-i", action="store_true")
    return parser.parse_args(numbers_kept(words))


@pytest.mark.parametrize("word", ["-1e3", "-1E-3", "-.5e2", "-5.", "-2", "-2.5", "-1_0e1", "-inf"])
def test_a_negative_number_is_a_value(word: str) -> None:
    found = parsed(word, "--goal", word, "3")
    assert found.x == found.goal[0] == float(word)
    assert found.goal[1] == 3.0


@given(st.floats(allow_nan=False))
def test_every_number_comes_back_as_it_was(value: float) -> None:
    assert parsed(repr(value), "--goal", repr(value)).goal == [value]


@pytest.mark.parametrize("word", ["-i", "--goal", "-e3", "-1e", "-", "--", "", "1e3", "-1", "-0.5"])
def test_everything_else_stays_as_it_is(word: str) -> None:
    assert numbers_kept([word]) == [word]
