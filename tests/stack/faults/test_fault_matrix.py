"""Each row of the fault matrix in simulated time, by the command that makes it in full."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from checks.faults.cases import FAULTS

pytestmark = pytest.mark.stack

QUICK = ("robot killed", "robot stopped", "plant killed", "robot | router")
"""These rows use real processes, too: each takes some seconds."""
LATE = re.compile(r", wall: ((known|stopped) after \d+ ms|reported BUDGET)")
"""In wall time a busy machine may be late, and a robot that notices stops for that; how late is in
docs/evidence/faults.md."""


def bench(*words: str, within_s: float = 240.0) -> tuple[int, str, str]:
    line = [sys.executable, "-m", "checks/speed", "faults", *words]
    done = subprocess.run(line, capture_output=True, text=True, timeout=within_s, check=False)
    return done.returncode, done.stdout, done.stderr


def test_each_row_is_as_it_must_be(tmp_path: Path) -> None:
    words = ("--short", "--wall", "0", "--json", "--page", str(tmp_path / "faults.md"))
    code, said, told = bench(*words)
    assert json.loads(said)["notes"] == [], told
    assert code == 0
    page = (tmp_path / "faults.md").read_text()
    rows = [line for line in page.splitlines() if line.startswith("| ") and "must" not in line[:20]]
    assert len(rows) == len(FAULTS)
    assert not (tmp_path / "faults.jsonl").exists()


@pytest.mark.realtime
def test_real_processes_react_as_they_must() -> None:
    code, said, told = bench(
        "--short", "--lockstep", "0", "--json", "--jobs", "4", "--only", *QUICK
    )
    notes = json.loads(said)["notes"]
    assert told.count("wall ") == len(QUICK), told
    assert [note for note in notes if not LATE.search(note)] == [], told
    assert code == (0 if not notes else 1)


def test_what_is_kept_is_not_measured_again(tmp_path: Path) -> None:
    kept = tmp_path / "kept.jsonl"
    words = ("--only", "emergency stop", "--lockstep", "2", "--wall", "0", "--keep", str(kept))
    for measured in (2, 0):
        code, said, told = bench(*words)
        assert code == 0, said
        assert told.count("as required") == measured
    assert len(kept.read_text().splitlines()) == 2


def test_a_fault_that_there_is_not_is_refused_with_those_there_are() -> None:
    code, _, told = bench("--only", "earthquake")
    assert code != 0
    assert "no fault is named earthquake" in told
    assert "robot killed" in told
