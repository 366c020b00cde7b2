"""The blocks of the tutorial and of the guides: each is run, here or by a file that exists."""

from pathlib import Path

from tests.support.docs.console import Command, steps_of
from tests.support.docs.session import ROOT
from tests.support.each import each

DOCS = ROOT / "docs"
PAGES = sorted([*(DOCS / "tutorial").glob("*.md"), *(DOCS / "how-to").glob("*.md")])
COMMANDS = {page: [step for step in steps_of(page) if isinstance(step, Command)] for page in PAGES}


@each("page", PAGES)
def test_commands_that_another_file_runs_name_that_file(page: Path) -> None:
    named = {command.runner for command in COMMANDS[page] if command.runner is not None}
    assert [name for name in named if not (ROOT / name).is_file()] == []


@each("page", PAGES)
def test_blocks_with_commands_are_of_the_language_console(page: Path) -> None:
    """Reject blocks of other languages: they would not be run."""
    fences = [
        line.strip() for line in page.read_text(encoding="utf-8").splitlines() if "```" in line
    ]
    assert {"```sh", "```shell", "```bash", "```"}.isdisjoint(fences[::2])
