"""The check of commit messages that the hook calls."""

import subprocess
from pathlib import Path

import pytest

from checks.commit_message import advice, problems
from tests.support.each import each

ROOT = Path(__file__).resolve().parents[3]


@each(
    "message",
    [
        "robot: stop on a stale scan\n",
        "docs, tests: add a guide\n\nThe reason.\n# a comment of git that is far too long "
        + "x" * 80,
        "study/report: feed rows\n\n" + "x" * 90,
        "Merge branch 'main' into docs\n",
        'Revert "robot: stop"\n',
    ],
)
def test_good_message_passes(message: str) -> None:
    assert problems(message) == []


@each(
    ("message", "problem"),
    [
        ("", "the message is empty"),
        ("# only a comment\n", "the message is empty"),
        ("stop on a stale scan", "line 1: write `area: imperative subject`"),
        ("robot: stop on a stale scan.", "without a full stop"),
        (f"robot: {'x' * 66}", "line 1: 73 characters: use at most 72"),
        ("robot: stop\nbecause", "line 2: leave it empty"),
        (f"robot: stop\n\nwhy {'x' * 70}", "line 3: 74 columns: use at most 72"),
    ],
)
def test_defect_of_a_message_is_named(message: str, problem: str) -> None:
    (found,) = problems(message)
    assert problem in found


@each(
    ("message", "advised"),
    [("robot: stopped on a scan\n", "'stopped'"), ("robot: feed rows\n", ""), ("Revert x\n", "")],
)
def test_other_form_of_a_verb_is_only_advice(message: str, advised: str) -> None:
    assert problems(message) == []
    assert " ".join(advice(message)).startswith(advised)
    assert bool(advice(message)) == bool(advised)


@pytest.mark.parametrize(
    ("message", "code"), [("robot: stop\n", 0), ("robot: adding a stop\n", 0), ("stop\n", 1)]
)
def test_hook_refuses_a_bad_message(message: str, code: int, tmp_path: Path) -> None:
    file = tmp_path / "COMMIT_EDITMSG"
    file.write_text(message)
    done = subprocess.run(
        ["python3", ROOT / "checks" / "commit_message.py", file],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code
    assert ("CONTRIBUTING.md" in done.stderr) == bool(code)
