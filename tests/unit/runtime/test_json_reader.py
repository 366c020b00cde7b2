"""JSON from untrusted sources is read, or refused with ValueError, at any depth or length."""

import json
from math import inf

import pytest

from runtime.files import MAX_DEPTH, value_in
from tests.support.each import each


def nested(depth: int, opens: str = "[", closes: str = "]") -> str:
    return opens * depth + closes * depth


def test_valid_json_is_read() -> None:
    assert value_in('{"a": [1, 2.5, "x", null]}') == {"a": [1, 2.5, "x", None]}
    assert value_in(b"3") == 3
    assert value_in("1" * 19) == float("1" * 19)
    assert value_in("9" * 400) == inf


@each("depth", [MAX_DEPTH + 1, 900, 5000, 100_000])
def test_too_deep_nesting_is_refused(depth: int) -> None:
    """Refuse it even if the parser accepts it, because a writer would not."""
    with pytest.raises(ValueError, match="nested too deeply"):
        value_in(nested(depth))
    with pytest.raises(ValueError, match="nested too deeply"):
        value_in(nested(depth, '{"a":', "}").replace(":}", ":1}"))


def test_nesting_at_the_limit_is_read() -> None:
    value = value_in(nested(MAX_DEPTH))
    assert json.dumps(value) == nested(MAX_DEPTH)


@each("text", ["", "{", b"\xff\xfe", "nonsense", b"\x00"])
def test_invalid_json_is_a_value_error(text: str | bytes) -> None:
    with pytest.raises(ValueError, match=r"Expecting|decode|codec"):
        value_in(text)
