"""The reader of pages with commands: what it finds, and which output it accepts."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.docs.console import Command, File, Stop, matches, renewed, steps, steps_of
from tests.support.each import each

PAGE = """\
Text.

```toml title="a.toml"
x = 1
```

<!-- console: exit 1 -->
```console
$ one \\
    two
out
$ three
```

<!-- console: stop -->

<!-- console: run by tests/a.py -->
```console
$ four
```
""".splitlines()


def test_page_is_read_in_order() -> None:
    assert list(steps(PAGE)) == [
        File("a.toml", "x = 1\n"),
        Command(9, "one two", ("out",), "exit 1"),
        Command(12, "three", (), "exit 1"),
        Stop(),
        Command(19, "four", (), "run by tests/a.py"),
    ]


def test_directive_sets_exit_code_and_runner() -> None:
    _, first, *_, last = (step for step in steps(PAGE) if not isinstance(step, Stop))
    assert isinstance(first, Command)
    assert isinstance(last, Command)
    assert (first.exit_code, first.runner) == (1, None)
    assert (last.exit_code, last.runner) == (0, "tests/a.py")


@each(
    ("expected", "printed"),
    [
        (["reached after 1.7 s"], ["reached after 12 s"]),
        (["pose  0.5 -3"], [" pose -0.51   4.0 "]),
        (["a ... b"], ["a x y b"]),
        (["...", "b", "..."], ["a", "b"]),
        (["a", "", "b"], ["a", "b", ""]),
        ([], []),
    ],
)
def test_output_matches(expected: list[str], printed: list[str]) -> None:
    assert matches(expected, printed)


@each(
    ("expected", "printed"),
    [
        (["reached after 1.7 s"], ["reached after - s"]),
        (["reached"], ["reached", "more"]),
        (["a", "b"], ["a"]),
        (["a ... b"], ["a", "b"]),
        ([], ["a"]),
        (["a.b"], ["axb"]),
    ],
)
def test_other_output_does_not_match(expected: list[str], printed: list[str]) -> None:
    assert not matches(expected, printed)


def test_exact_numbers_must_be_equal() -> None:
    assert matches(["5.25 m"], ["5.25 m"], is_exact=True)
    assert not matches(["5.25 m"], ["5.26 m"], is_exact=True)


@pytest.mark.parametrize(
    ("expected", "printed", "lines"),
    [
        (["a 1", "b 2"], ["a 7", "c 3"], ["a 1", "c 3"]),
        (["a", "...", "z 1"], ["b", "x", "y", "z 2"], ["b", "...", "z 1"]),
        (["a", "", "z"], ["a", "", "m"], ["a", "", "m"]),
        (["a", "b", "c"], ["a", "c"], ["a", "c"]),
        ([], ["  a", "", "b"], ["  a", "", "b"]),
        (["..."], [], ["..."]),
    ],
)
def test_renewed_output_keeps_the_lines_that_match(
    expected: list[str], printed: list[str], lines: list[str]
) -> None:
    assert renewed(expected, printed) == lines


LINES = st.lists(st.sampled_from(["", "...", "a", "a 1", "a 2.5", "b", "b ... c", "1 try"]))
PRINTED = st.lists(st.sampled_from(["", "a", "  a 2", "a -3.5", "b", "b x c", "2 tries", "1e5."]))


@given(expected=LINES, printed=PRINTED, is_exact=st.booleans())
def test_renewed_output_matches(expected: list[str], printed: list[str], is_exact: bool) -> None:
    lines = renewed(expected, printed, is_exact=is_exact)
    assert matches(lines, printed, is_exact=is_exact)
    if matches(expected, printed, is_exact=is_exact) and any(map(str.strip, expected)):
        assert lines == expected


def test_page_is_read_from_its_file(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text("\n".join(PAGE))
    assert len(steps_of(tmp_path / "page.md")) == 5
