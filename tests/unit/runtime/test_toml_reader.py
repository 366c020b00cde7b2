import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.toml_reader import TooDeepError, key_lines

TEXT = '''# a comment with [[obstacle]] in it
name = "a # no comment"   # but this is one

size_m = [
  6.0,
  4.0, # the depth
]
start = { x_m = 1.5, heading_deg = 0 }
doc = """
[not_a_table]
x = 1
"""
[robot]
radius_m = 0.12
[[obstacle]]
circle_m = { x = 1,
  y = 2 }

[[obstacle]]
[obstacle.circle_m]
x = 3
[after."quoted key"]
deep.er = 1
'''.replace("x = 1,\n  y", "x = 1, y")  # inline tables stay on one line


def test_each_key_is_found_on_its_line() -> None:
    lines = key_lines(TEXT)
    assert lines[("name",)] == 2
    assert lines[("size_m",)] == 4
    assert lines[("size_m", 1)] == 6
    assert lines[("start", "heading_deg")] == 8
    assert lines[("doc",)] == 9
    assert lines[("robot", "radius_m")] == 14


def test_the_nth_table_of_a_list_has_its_own_lines() -> None:
    lines = key_lines(TEXT)
    assert lines[("obstacle", 0)] == 15
    assert lines[("obstacle", 0, "circle_m", "y")] == 16
    assert lines[("obstacle", 1)] == 18
    assert lines[("obstacle", 1, "circle_m", "x")] == 20


def test_quoted_and_dotted_keys_are_found() -> None:
    assert key_lines(TEXT)[("after", "quoted key", "deep", "er")] == 22


def test_what_only_looks_like_a_key_is_not_one() -> None:
    assert not any("not_a_table" in key for key in key_lines(TEXT))


def test_an_empty_text_has_no_keys() -> None:
    assert key_lines("") == {}


scalars = st.one_of(
    st.integers(-1000, 1000).map(str), st.floats(-9, 9).map(lambda x: f"{x:.3f}"), st.just("true")
)
names = st.text("abcdefgh_", min_size=1, max_size=6)
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3).map(lambda parts: f"[{', '.join(parts)}]")
)


@given(st.dictionaries(names, values, max_size=8))
def test_a_flat_file_has_one_key_per_line(table: dict[str, str]) -> None:
    text = "\n".join(f"{name} = {value}" for name, value in table.items())
    lines = key_lines(text)
    assert set(tomllib.loads(text)) == {key[0] for key in lines}
    assert [lines[(name,)] for name in table] == list(range(1, len(table) + 1))


@given(st.text("[]{}=.,\"'#\n ab1", max_size=60))
def test_even_nonsense_is_scanned_to_its_end(text: str) -> None:
    assert all(1 <= line <= text.count("\n") + 1 for line in key_lines(text).values())


def test_lists_nested_too_deeply_are_refused() -> None:
    with pytest.raises(TooDeepError, match="nested too deeply"):
        key_lines("a = " + "[" * 100_000)
