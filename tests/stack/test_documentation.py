"""Pages are followed: tutorial, guides, the first change, and the first ten minutes."""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final, NamedTuple

import pytest

from tests.support.pages import ROOT, Command, Session, matches, session, steps_of
from tests.support.screens import Tmux

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


PAGE = ROOT / "CONTRIBUTING.md"
OUTER = ("MAKEFLAGS", "MAKELEVEL", "CI", "PYTEST_ADDOPTS")
"""Of a `make` or pytest around this test; a newcomer has none of them."""


def git(folder: Path, *words: str) -> str:
    done = subprocess.run(("git", "-C", str(folder), *words), stdout=subprocess.PIPE, check=True)
    return done.stdout.decode().strip()


def set_up(checkout: Path) -> tuple[str, ...]:
    """Give a clone the set-up of this checkout; return the words that run a command in it.

    Python and sidestep run the modules of the clone with the packages of this checkout, and git
    has an author but no settings of a user. It is no CI, and no recipe of a `make` around it. Its
    pytest has a folder of its own for temporary files: at its end it deletes those of earlier runs
    there, and the thousands of the gate around it can take minutes on a busy disk.
    """
    programs = checkout / ".venv" / "bin"
    programs.mkdir(parents=True)
    for name, words in (("python", ""), ("sidestep", "-m sidestep ")):
        program = programs / name
        program.write_text(f'#!/bin/sh\nexec {sys.executable} {words}"$@"\n')
        program.chmod(0o755)
    (checkout / ".venv" / "ready").write_text(f"{checkout}\n")
    return (
        *("env", *(word for name in OUTER for word in ("-u", name))),
        f"PATH={programs}:{Path(sys.executable).parent}:/usr/local/bin:/usr/bin:/bin",
        f"PYTHONPATH={checkout}",
        f"PYTEST_DEBUG_TEMPROOT={checkout.parent}",
        "GIT_CONFIG_NOSYSTEM=1",
        *(f"GIT_{role}_NAME=Newcomer" for role in ("AUTHOR", "COMMITTER")),
        *(f"GIT_{role}_EMAIL=newcomer@example.com" for role in ("AUTHOR", "COMMITTER")),
    )


@pytest.mark.stack
@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="no checkout of git")
def test_first_change_prints_what_the_page_shows(tmp_path: Path) -> None:
    checkout = tmp_path.resolve() / "sidestep"
    git(ROOT, "clone", "--quiet", "--shared", str(ROOT), str(checkout))
    before = git(checkout, "rev-parse", "HEAD")
    shell = Session(checkout, set_up(checkout))
    for step in steps_of(PAGE):
        if isinstance(step, Command) and step.runner is not None:
            assert (ROOT / step.runner).is_file(), f"{step.line}: {step.runner}"
        printed = shell.run(step)
        if isinstance(step, Command) and printed is not None:
            text = "\n".join((f"{PAGE.name}:{step.line}: {step.words}", *printed))
            assert matches(step.output, printed, is_exact=step.is_exact), text
    assert git(checkout, "rev-parse", "HEAD~1") == before, f"{PAGE.name} commits no change"


class TutorialStep(NamedTuple):
    """The words that must be on the screen, then the keys that they ask for, by tmux's names."""

    name: str
    before: tuple[str, ...]
    keys: tuple[str, ...]


STEPS: Final = (
    TutorialStep("first goal", ("1 Drive", "TUTORIAL 1 of 8", "space E-STOP", "? Help"), ()),
    TutorialStep(
        "own goal", ("TUTORIAL 2 of 8", "press g, type 1 1", "g Goal"), ("g", "1 1", "Enter")
    ),
    TutorialStep("driving", ("goal 1 1: ok", "h Hold", "x Abort"), ()),
    TutorialStep("cursor", ("TUTORIAL 3 of 8", "G shows a cursor", "goal REACHED"), ("G",)),
    TutorialStep("first waypoint", ("enter Go", "w Waypoint", "Move"), (*["Up"] * 4, "w")),
    TutorialStep("second waypoint", ("waypoint 1:", "W Send 1 waypoint"), (*["Right"] * 4, "w")),
    TutorialStep("send", ("TUTORIAL 4 of 8", "press W", "W Send 2 waypoints"), ("W",)),
    TutorialStep("start", ("TUTORIAL 5 of 8", "W Start mission"), ("W",)),
    TutorialStep("stop", ("TUTORIAL 6 of 8", "press space", "space E-STOP"), ("Space",)),
    TutorialStep("clear", ("TUTORIAL 7 of 8", "EMERGENCY STOP", "D D Clear E-STOP"), ("D", "D")),
    TutorialStep("arm", ("TUTORIAL 8 of 8", "DISARMED", "a arm"), ("a",)),
    TutorialStep("help", ("TUTORIAL  all done", "ARMED", "? Help"), ("?",)),
    TutorialStep("end", ("examples", "esc closes"), ("Escape",)),
)


@pytest.mark.stack
@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
def test_every_step_shows_what_it_must(tmp_path: Path) -> None:
    """Drive the app by keys alone, as a new user does: each stands on the screen before."""
    words = ("env", "-u", "COLUMNS", "-u", "LINES", f"PYTHONPATH={ROOT}", sys.executable)
    with Tmux(tmp_path, (*words, "-m", "sidestep", "tutorial", "--speed", "3"), (100, 30)) as tmux:
        for step in STEPS:
            tmux.shows(*step.before)
            tmux.press(*step.keys)
