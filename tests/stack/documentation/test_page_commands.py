"""Each command of the tutorial and of the how-to guides is run, and its output compared."""

from pathlib import Path

import pytest

from tests.support.docs.console import Command, matches, steps_of
from tests.support.docs.session import ROOT, session

DOCS = ROOT / "docs"
PAGES = sorted([*(DOCS / "tutorial").glob("*.md"), *(DOCS / "how-to").glob("*.md")])
COMMANDS = {page: [step for step in steps_of(page) if isinstance(step, Command)] for page in PAGES}
RUN_HERE = [page for page in PAGES if any(step.runner is None for step in COMMANDS[page])]


@pytest.mark.stack
@pytest.mark.parametrize("page", RUN_HERE, ids=lambda page: page.stem)
def test_commands_print_what_the_page_shows(page: Path, tmp_path: Path) -> None:
    with session(tmp_path) as shell:
        for step in steps_of(page):
            printed = shell.run(step)
            if isinstance(step, Command) and printed is not None:
                place = f"{page.relative_to(ROOT)}:{step.line}: {step.words}"
                text = "\n".join(printed)
                assert matches(step.output, printed, is_exact=step.is_exact), f"{place}\n{text}"
