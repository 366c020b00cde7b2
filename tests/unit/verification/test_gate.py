"""The gate runs every step of both kinds and fails when one of them does."""

import os
import sys
from pathlib import Path

import pytest

from verification.gate import Gate, Step, computing, real_time, run

PASSES = Step("passes", (sys.executable, "-c", "print('well')"))
FAILS = Step("fails", (sys.executable, "-c", "raise SystemExit('badly')"))
MEETS = """
import sys
from pathlib import Path
from tests.support.until import until
mine, other = map(Path, sys.argv[1:])
mine.touch()
until(other.exists)
"""
CLASS = Step("class", (sys.executable, "-c", "import os; print('class', os.sched_getscheduler(0))"))


def meeting(mine: Path, other: Path) -> Step:
    return Step("meeting", (sys.executable, "-c", MEETS, str(mine), str(other)))


def test_both_kinds_can_run_at_the_same_time(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    assert run(Gate(), [meeting(one, other)], [meeting(other, one)], side_by_side=True) == 0
    assert "all passed" in capfd.readouterr().out


@pytest.mark.parametrize("side_by_side", [False, True])
@pytest.mark.parametrize("lanes", [([FAILS, PASSES], []), ([], [FAILS, PASSES])])
def test_failed_step_is_named_and_the_next_one_runs(
    lanes: tuple[list[Step], list[Step]], *, side_by_side: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run(Gate(), *lanes, side_by_side=side_by_side) == 1
    said = capfd.readouterr()
    assert "well" in said.out
    assert "badly" in said.out + said.err
    assert "FAILED: fails (" in said.err


@pytest.mark.parametrize(
    ("side_by_side", "expected"), [(True, os.SCHED_IDLE), (False, os.sched_getscheduler(0))]
)
def test_what_computes_beside_has_the_idle_class(
    capfd: pytest.CaptureFixture[str], *, side_by_side: bool, expected: int
) -> None:
    assert run(Gate(), [], [CLASS], side_by_side=side_by_side) == 0
    assert f"class {expected}" in capfd.readouterr().out


def test_every_test_is_in_one_of_the_steps() -> None:
    steps = [step.words for step in (*real_time(["--no-skips"]), *computing(["--no-skips"]))]
    chosen = [words[words.index("-m", 2) + 1] for words in steps if "pytest" in words]
    assert chosen == ["stack and not compose", "compose", "not stack and not compose"]
    assert all("--no-skips" in words for words in steps if "pytest" in words)
