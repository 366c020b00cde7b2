"""The same trial gives the same digest with every Python, process and processor."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from study.trial.trial import NAVIGATORS
from tests.support import digests
from tests.support.digests import Run
from tests.support.each import each

KNOWN = digests.committed()["digests"]
RUNS = list(digests.runs())

ELSEWHERE = """
import sys
from tests.support.digests import Run
for navigator in sys.argv[1:]:
    print(Run("u_trap", navigator, "harsh").digest())
"""


@each("run", RUNS)
def test_a_trial_has_its_committed_digest(run: Run) -> None:
    digest = run.digest()
    assert digest == KNOWN[str(run)], digests.difference(str(run), digest)


PLAIN_PROCESSOR = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable,-FMA_Usable",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 X86_V3",
}
"""The C library and numpy compute without instructions that round differently."""


def test_other_hashes_and_a_plainer_processor_drive_the_same_way() -> None:
    child = subprocess.run(
        [sys.executable, "-c", ELSEWHERE, *NAVIGATORS],
        cwd=Path(__file__).parents[2],
        env={**os.environ, **PLAIN_PROCESSOR, "PYTHONHASHSEED": "4711"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    known = [KNOWN[f"u_trap/{navigator}/harsh"] for navigator in NAVIGATORS]
    assert child.stdout.split() == known, child.stderr


def test_the_trials_differ_from_each_other() -> None:
    """Equal digests would prove nothing if every run had the same one."""
    assert {"bug", "vgm"} <= {run.navigator for run in RUNS}
    assert len({KNOWN[str(run)] for run in RUNS if run.navigator == "vgm"}) == len(
        [run for run in RUNS if run.navigator == "vgm"]
    )


def test_every_trial_of_the_set_has_a_committed_digest() -> None:
    assert sorted(KNOWN) == sorted(map(str, digests.runs()))


def test_a_difference_names_other_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    name = next(iter(KNOWN))
    assert digests.difference(name, "00") == f"{name}: 00 instead of the committed {KNOWN[name]}"
    monkeypatch.setattr(digests, "versions", lambda: {"numpy": "1"})
    assert "here are {'numpy': '1'}" in digests.difference(name, "00")
