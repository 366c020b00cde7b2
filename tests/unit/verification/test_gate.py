"""The gate runs the steps of all lanes and fails when one of them does."""

import os
import sys
from pathlib import Path

import pytest

from verification.gate import Gate, Lane, Step, lanes

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
    """Return a step that ends only when another one runs at the same time."""
    return Step("meeting", (sys.executable, "-c", MEETS, str(mine), str(other)))


@pytest.mark.parametrize("is_idle", [False, True])
def test_lanes_run_at_the_same_time(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], *, is_idle: bool
) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    first, second = Lane([meeting(one, other)]), Lane([meeting(other, one)], is_idle=is_idle)
    assert Gate().run([first, second]) == 0
    assert "all passed" in capfd.readouterr().out


@pytest.mark.parametrize("is_idle", [False, True])
def test_failed_step_is_named_and_the_next_one_runs(
    capfd: pytest.CaptureFixture[str], *, is_idle: bool
) -> None:
    assert Gate().run([Lane([FAILS, PASSES], is_idle=is_idle), Lane([])]) == 1
    said = capfd.readouterr()
    assert "well" in said.out
    assert "badly" in said.out
    assert "FAILED: fails (" in said.err


@pytest.mark.parametrize(
    ("is_idle", "expected"), [(True, os.SCHED_IDLE), (False, os.sched_getscheduler(0))]
)
def test_idle_lane_has_the_idle_class(
    capfd: pytest.CaptureFixture[str], *, is_idle: bool, expected: int
) -> None:
    assert Gate().run([Lane([CLASS], is_idle=is_idle)]) == 0
    assert f"class {expected}" in capfd.readouterr().out


def test_every_test_is_in_one_of_the_steps() -> None:
    steps = [step.words for lane in lanes(["--no-skips"]) for step in lane.steps]
    chosen = [words[words.index("-m", 2) + 1] for words in steps if "pytest" in words]
    assert chosen == ["stack and not compose", "compose", "not stack and not compose"]
    assert all("--no-skips" in words for words in steps if "pytest" in words)
