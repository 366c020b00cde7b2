"""The commands of the guide "Run the core on a microcontroller"."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).resolve().parents[2]
DIGEST: Final = re.compile(r"^ *digest +([0-9a-f]{64})$", re.MULTILINE)
WITHIN_S: Final = 240.0
DRIVE: Final = ("--world", "open", "--goal", "2", "2")


def sidestep(*words: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run a verb in another folder."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "HOME": str(folder)}
    return subprocess.run(
        [sys.executable, "-m", "sidestep", *words],
        cwd=folder, env=environment, timeout=WITHIN_S, text=True, capture_output=True, check=False,
    )  # fmt: skip


def digest_of(ended: "subprocess.CompletedProcess[str]") -> str:
    assert ended.returncode == 0, ended.stdout + ended.stderr
    found = DIGEST.findall(ended.stdout)
    assert len(found) == 1, ended.stdout
    return str(found[0])


@pytest.mark.mcu
@pytest.mark.usefixtures("firmware")
def test_drives_on_the_board_print_the_digest_of_a_trial(tmp_path: Path) -> None:
    trial = digest_of(sidestep("trial", *DRIVE, folder=tmp_path))
    on_board = digest_of(sidestep("trial", "--mcu", *DRIVE, folder=tmp_path))
    words = ("up", "--mcu", "--headless", "--no-record", "--speed", "20", *DRIVE)
    stack = digest_of(sidestep(*words, folder=tmp_path))
    assert on_board == stack == trial
