"""JSON from others: read, or refused by one kind of error, however deep or long it is."""

import json
from math import inf

import pytest

from runtime.json_reader import MAX_DEPTH, value_in


def nested(depth: int, opens: str = "[", closes: str = "]") -> str:
    return opens * depth + closes * depth


def test_what_it_says() -> None:
    assert value_in('{"a": [1, 2.5, "x", null]}') == {"a": [1, 2.5, "x", None]}
    assert value_in(b"3") == 3
    assert value_in("1" * 19) == float("1" * 19)
    assert value_in("9" * 400) == inf


@pytest.mark.parametrize("depth", [MAX_DEPTH + 1, 900, 5000, 100_000])
def test_what_is_nested_too_deeply_is_refused(depth: int) -> None:
    """Also where the parser takes it: whoever writes it again would not."""
    with pytest.raises(ValueError, match="nested too deeply"):
        value_in(nested(depth))
    with pytest.raises(ValueError, match="nested too deeply"):
        value_in(nested(depth, '{"a":', "}").replace(":}", ":1}"))


def test_what_is_just_not_too_deep_is_read() -> None:
    value = value_in(nested(MAX_DEPTH))
    assert json.dumps(value) == nested(MAX_DEPTH)


@pytest.mark.parametrize("text", ["", "{", b"\xff\xfe", "nonsense", b"\x00"])
def test_what_is_no_json_is_a_value_error(text: str | bytes) -> None:
    with pytest.raises(ValueError, match=r"Expecting|decode|codec"):
        value_in(text)
