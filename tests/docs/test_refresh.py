"""Pages are renewed as a whole or not at all, and the difference is shown."""

from pathlib import Path

import pytest

from tests.support.docs.refresh import main

PAGE = """\
# A page

```console
$ echo from 7; echo an apple
from 3
a pear
$ printf 'same %s\\n' \\
    1
same 2
```

1. A step:

    ```console
    $ printf 'a\\n  b\\n'; pwd
    old
    ```

<!-- console: run by tests/docs/test_refresh.py -->
```console
$ false
old
```
"""
RENEWED = PAGE.replace("from 3\na pear", "from 3\nan apple").replace(
    "    old\n", "    a\n      b\n    ...\n"
)
FAILING = """\
```console
$ echo new
old
$ echo a reason; exit 3
```
"""


@pytest.fixture
def page(tmp_path: Path) -> Path:
    path = tmp_path / "page.md"
    path.write_text(PAGE)
    return path


def test_only_outputs_that_differ_are_renewed(
    page: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main([str(page)], root=page.parent) == 0
    assert page.read_text() == RENEWED
    assert [path.name for path in page.parent.iterdir()] == ["page.md"]
    printed = capfd.readouterr().out
    assert "page.md: 2 of 3 outputs renewed; others, not renewed, are run by " in printed
    assert "1 file changed, 4 insertions(+), 2 deletions(-)" in printed
    assert "\n-a pear\n+an apple\n" in printed
    assert main([str(page)], root=page.parent) == 0
    assert page.read_text() == RENEWED
    printed = capfd.readouterr().out
    assert printed.startswith("page.md: 0 of 3 outputs renewed")
    assert printed.endswith("nothing has changed\n")


def test_page_with_a_failing_command_is_left_alone(
    page: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    failing = page.with_name("failing.md")
    failing.write_text(FAILING)
    assert main([str(page.parent)], root=page.parent) == 1
    assert failing.read_text() == FAILING
    assert page.read_text() == RENEWED
    printed = capfd.readouterr()
    words = "line 4: $ echo a reason; exit 3\na reason\nexit code 3, not 0\n"
    assert f"failing.md: FAILED\n{words}" in printed.out
    assert "FAILED: failing.md" in printed.err


def test_output_that_would_be_a_command_is_not_written(
    page: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    text = "```console\n$ echo '$ rm file'\n```\n"
    page.write_text(text)
    assert main([str(page)], root=page.parent) == 1
    assert page.read_text() == text
    assert "begins with `$ `" in capfd.readouterr().out


def test_part_that_is_no_page_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([str(tmp_path)], root=tmp_path)
    assert "no page with commands" in capsys.readouterr().err
