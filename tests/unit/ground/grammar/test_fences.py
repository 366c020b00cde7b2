"""A fence as typed: a circle, corners in order, or a file; one without an area is refused."""

import argparse
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.client.operations.fences import SetFence, in_words
from ground.grammar.fences import FenceWords, SetFenceOfFile, outlined
from ground.missions.mission import Circle, Fence, Polygon
from runtime.errors import UserError
from tests.support.each import each
from tests.support.ground.missions.made_up import polygons, refusal_of


def typed(*words: str) -> Fence:
    """Return the fence that is set, from a file if one was named."""
    parser = argparse.ArgumentParser()
    FenceWords.declare(parser)
    operation = parser.parse_args(list(words), FenceWords("fence")).operation()
    if isinstance(operation, SetFenceOfFile):
        operation = operation.read()
    assert isinstance(operation, SetFence)
    return operation.fence


def test_a_circle_has_a_place_and_a_radius() -> None:
    fence = typed("circle", "1", "-2", "3.5")
    assert fence == Circle(x_m=1.0, y_m=-2.0, radius_m=3.5)
    assert in_words(fence) == "circle of 3.5 m around (1, -2)"


def test_corners_follow_each_other() -> None:
    fence = typed("polygon", "0", "0", "4", "0", "4", "-3")
    assert fence == Polygon(corners=((0.0, 0.0), (4.0, 0.0), (4.0, -3.0)))
    assert in_words(fence) == "polygon of 3 corners: (0, 0) (4, 0) (4, -3)"


@given(polygons())
def test_every_outline_can_be_typed(polygon: Polygon) -> None:
    words = [repr(number) for corner in polygon.corners for number in corner]
    assert outlined(words) == polygon


@each(
    ("words", "why"),
    [
        (["0"], "1 numbers are not pairs: give X Y for each corner"),
        (["0", "0", "1", "1"], "has 2 corners, a fence needs at least 3; give the corners"),
        (["0", "0", "x", "1"], "'x' is not a number; a fence is X Y X Y"),
        (["0", "0", "inf", "1"], "'inf' is not a finite number"),
        (["0", "0", "9e9", "1", "1", "1"], "corner 9e[+]09 m is out of range"),
        (["0", "0", "1", "1", "1", "0", "0", "1"], "side 0 and side 2 cross"),
        (["0", "0", "1", "1", "2", "2"], "encloses nothing"),
    ],
)
def test_what_is_no_fence_is_refused_with_the_reason_and_the_fix(
    words: list[str], why: str
) -> None:
    with pytest.raises(UserError, match=why):
        outlined(words)


@given(st.lists(st.text(max_size=8) | st.floats().map(repr), min_size=1, max_size=9))
def test_any_words_are_a_fence_or_a_reason(words: list[str]) -> None:
    refusal_of(lambda: outlined(words))


def test_a_circle_too_far_away_is_refused() -> None:
    with pytest.raises(UserError, match="x 300000 m is out of range"):
        (typed("circle", "300000", "0", "1"))


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / "f.toml"
    with pytest.raises(UserError, match="no such file"):
        (typed("polygon", str(path)))
    path.write_text("[fence]\ncorners = [[0, 0], [1, 0]]\n")
    with pytest.raises(UserError, match=r"f\.toml:2: fence\.corners: has 2 corners"):
        (typed("polygon", str(path)))
    path.write_text("")
    with pytest.raises(UserError, match=r"has no fence; add \[fence\]"):
        (typed("polygon", str(path)))
