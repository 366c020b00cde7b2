"""First drives beside busy processes arrive with the digest of the trial, and leave nothing."""

import os
import signal
import sys
from pathlib import Path

import pytest

from tests.support.stack.process_table import ROOT, alive, children_of, cmdline
from tests.support.stack.processes import Crew, Running
from tests.support.until import until

pytestmark = pytest.mark.stack

TOOL = (sys.executable, "-m", "checks.first_drives")
DRIVES_S = 240.0
NAME = "short.toml"
SHORT = """
name = "short"
size_m = [4.0, 3.0]
start = { x_m = 0.7, y_m = 1.1, heading_deg = 0.0 }
goal = { x_m = 1.9, y_m = 1.1, heading_deg = 0.0 }
"""


def busy_processes(running: Running) -> list[int]:
    found = []
    for pid in children_of(running.process.pid):
        try:
            found += [pid] if "checks.harness.busy" in cmdline(pid) else []
        except (FileNotFoundError, ProcessLookupError):
            continue
    return found


def test_first_drives_arrive_with_the_digest_of_the_trial(tmp_path: Path) -> None:
    """Start no busy process: other tests run beside it, and the next test has some."""
    (tmp_path / NAME).write_text(SHORT)
    there = ("env", "-C", str(tmp_path), f"PYTHONPATH={ROOT}")
    words = ("--drives", "2", "--busy", "0", "--parallel", "2", "--worlds", NAME)
    with Crew() as crew:
        drives = crew.execute(*there, *TOOL, *words)
        assert drives.ends(DRIVES_S) == 0, drives.said
        head, _, *rows = drives.said.splitlines()[-5:]
        assert head.startswith("2 first drives beside 0 busy processes on ")
        assert [row.split()[:2] for row in rows[:2]] == [
            [NAME, "app"],
            [NAME, "headless"],
        ]
        assert all("1 of 1" in row and "equal" in row for row in rows[:2])
        assert "2 of 2" in rows[2]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_busy_processes_end_with_the_tool(number: signal.Signals) -> None:
    with Crew() as crew:
        drives = crew.execute(*TOOL, "--drives", "1", "--busy", "2")
        until(lambda: len(busy_processes(drives)) == 2, what="busy processes")
        started = children_of(drives.process.pid)
        os.kill(drives.process.pid, number)
        drives.ends()
        until(lambda: not [pid for pid in started if alive(pid)], what="the end of all")
