"""The gate runs the steps of all lanes and fails when one of them does."""

import sys
from pathlib import Path

import pytest

from verification.gate import Gate, Step, phases

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
LAST = Step("last", (sys.executable, "-c", ""))


def meeting(mine: Path, other: Path) -> Step:
    """Return a step that ends only when another one runs at the same time."""
    return Step("meeting", (sys.executable, "-c", MEETS, str(mine), str(other)))


def test_lanes_of_a_phase_run_at_the_same_time(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    assert Gate().run([[[meeting(one, other)], [meeting(other, one)]]]) == 0
    assert "all passed" in capfd.readouterr().out


def test_phases_run_one_after_the_other(capfd: pytest.CaptureFixture[str]) -> None:
    assert Gate().run([[[PASSES]], [[LAST]]]) == 0
    out = capfd.readouterr().out
    assert out.index("well") < out.index("... last")


def test_failed_step_is_named_and_the_next_ones_run(capfd: pytest.CaptureFixture[str]) -> None:
    assert Gate().run([[[FAILS, PASSES], []], [[LAST]]]) == 1
    said = capfd.readouterr()
    assert "well" in said.out
    assert "badly" in said.out
    assert "... last" in said.out
    assert "FAILED: fails (" in said.err


def test_every_test_is_in_one_of_the_steps() -> None:
    lanes = [lane for phase in phases(["--no-skips"]) for lane in phase]
    steps = [step.words for lane in lanes for step in lane if "pytest" in step.words]
    steps = [words for words in steps if "--collect-only" not in words]
    chosen = [words[words.index("-m", 2) + 1] for words in steps]
    assert chosen == [
        "not stack and not compose and not interop and not mcu",
        "mcu",
        "stack and not compose",
        "compose",
        "interop and brief",
    ]
    assert all("--no-skips" in words for words in steps)
