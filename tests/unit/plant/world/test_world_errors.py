from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.model.errors import WorldError
from plant.world.file import loads
from tests.support.each import each
from tests.support.plant.world_texts import (
    GOOD,
    Bad,
    assert_told,
    more,
    refusal,
    start,
    with_line,
)

BAD = [
    Bad("an open list", with_line(2, "size_m = [6.0,"), 3, "start", "Invalid", "correct the TOML"),
    Bad("no value", with_line(1, "name ="), 1, "name", "Invalid value", "correct the TOML there"),
    Bad(
        "an open text", with_line(1, 'name = "test'), 1, "name", "Illegal", "correct the TOML there"
    ),
    Bad(
        "nothing closes",
        'name = "x"\nsize_m = [1,\n',
        3,
        "toml",
        "Invalid value",
        "correct the TOML",
    ),
    Bad(
        "twice", with_line(5, "size_m = [5.0, 4.0]"), 5, "size_m", "given twice", "keep one of them"
    ),
    Bad(
        "twice in a table",
        start("{ x_m = 0.6, x_m = 0.7, y_m = 2 }"),
        3,
        "start",
        "given twice (Duplicate inline table key 'x_m')",
        "keep one",
    ),
    Bad("two robots", more("[robot]\n[robot]\n"), 21, "robot", "given twice", "keep one of them"),
    Bad("too deep", "a = " + "[" * 5000, 1, "toml", "nested too deeply", "use fewer ["),
    Bad("too long", "a = " + "9" * 5000, 1, "a", "a number is too long", "correct the TOML"),
    Bad("a zero byte", "a = 1\nb = \x00", 2, "b", "Invalid value", "correct the TOML"),
]


@each("bad", BAD)
def test_invalid_toml_is_rejected(bad: Bad) -> None:
    assert_told(bad, alone=True)


def test_obstacle_must_be_a_table() -> None:
    text = "\n".join(["obstacle = [1]", *GOOD.split("\n")[:4]])
    error = refusal(text)
    assert str(error).startswith("bad.toml:1: obstacle#1: expected a table, found a whole number")


def test_all_errors_are_reported_in_the_order_of_the_file() -> None:
    text = with_line(2, "size_cm = [600, 400]", with_line(10, "circle_m = { x = 1, y = 2 }"))
    text = with_line(19, "", with_line(3, 'start = { x_m = "here", y_m = 2 }', text))
    keys = [problem.key for problem in refusal(text).problems]
    assert keys == [
        "size_cm",
        "start.x_m",
        "obstacle#2.circle_m.radius",
        "obstacle#4.speed_m_s",
    ]


def test_invalid_obstacle_does_not_hide_errors_in_start_or_goal() -> None:
    text = with_line(19, "", with_line(3, "start = { x_m = 2.5, y_m = 1.2 }"))
    assert [problem.key for problem in refusal(text).problems] == ["start", "obstacle#4.speed_m_s"]


@given(st.text(max_size=200))
def test_any_text_raises_only_world_errors(text: str) -> None:
    with pytest.raises(WorldError):
        loads(text)


VALUES = ["nan", "inf", "-1", "1e300", "true", '"x"', "[]", "{}", "[[1]]", "[{}]", "1979-05-27"]


@given(st.integers(1, 19), st.sampled_from(VALUES))
def test_any_value_raises_only_world_errors(number: int, value: str) -> None:
    key, equals, _ = GOOD.split("\n")[number - 1].partition(" = ")
    with suppress(WorldError):
        assert loads(with_line(number, f"{key} = {value}" if equals else ""))
