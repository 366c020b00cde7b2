"""The same trial gives the same digest: on every Python, in every process, whatever the hashes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from study.trial import NAVIGATORS
from tests import digests
from tests.digests import Run

KNOWN = digests.committed()["digests"]
RUNS = [run for run in digests.runs() if str(run) in KNOWN]

ELSEWHERE = """
import sys
from tests.digests import Run
print(Run(*sys.argv[1:]).digest())
"""


@pytest.mark.parametrize("run", RUNS, ids=str)
def test_a_trial_has_its_committed_digest_on_whatever_python_this_is(run: Run) -> None:
    excuse = digests.comparable()
    if excuse:
        pytest.xfail(f"{excuse}: compare Pythons with `python -m tests.digests`, --write first")
    assert run.digest() == KNOWN[str(run)]


@pytest.mark.parametrize("navigator", NAVIGATORS)
def test_a_process_of_its_own_with_other_hashes_drives_the_same_way(navigator: str) -> None:
    run = Run("box", navigator, "harsh")
    child = subprocess.run(
        [sys.executable, "-c", ELSEWHERE, *run],
        cwd=Path(__file__).parents[2],
        env={**os.environ, "PYTHONHASHSEED": "4711"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert child.stdout.strip() == run.digest(), child.stderr


def test_the_trials_differ_from_each_other() -> None:
    """Equal digests would prove nothing if every drive had the same one."""
    assert {"bug", "vgm"} <= {run.navigator for run in RUNS}
    assert len({KNOWN[str(run)] for run in RUNS if run.navigator == "vgm"}) == len(
        [run for run in RUNS if run.navigator == "vgm"]
    )


def test_another_arithmetic_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(digests, "arithmetic", lambda: "another")
    assert "rounds sin" in str(digests.comparable())
    monkeypatch.setattr(digests, "versions", lambda: {"numpy": "1"})
    assert "made with" in str(digests.comparable())
