"""The kernel ends a process whose loop hangs, whether Python's lock is held or not."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from runtime.watchdog import Watchdog

ROOT = Path(__file__).parents[3]
LOOP = """
import ctypes, sys, time
from pathlib import Path
from runtime.watchdog import Watchdog
trace = Path(sys.argv[2]) if len(sys.argv) > 2 else None
with Watchdog(0.5, trace) as watchdog:
    for _ in watchdog.reset_by(range(4)):
        time.sleep(0.2)
    print("driven", flush=True)
    {hang}
print("ended")
"""
HANGS = {
    "asleep": "time.sleep(30)",
    "holding Python's lock": "ctypes.PyDLL(None).sleep(30)",
    "busy": "[0 for _ in iter(int, 1)]",
}


def run(hang: str, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", LOOP.format(hang=hang), "x", *words],
        cwd=ROOT, capture_output=True, text=True, timeout=20.0, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("hang", HANGS.values(), ids=HANGS)
def test_hung_loop_ends_the_process_without_a_traceback(hang: str) -> None:
    done = run(hang)
    assert done.returncode == -signal.SIGALRM
    assert (done.stdout, done.stderr) == ("driven\n", "")


def test_stack_traces_of_a_hang_are_in_a_file(tmp_path: Path) -> None:
    trace = tmp_path / "hung.txt"
    done = run(HANGS["holding Python's lock"], str(trace))
    assert done.returncode == -signal.SIGALRM
    assert done.stderr == ""
    assert "most recent call first" in trace.read_text()


def test_after_the_block_the_timer_is_off(tmp_path: Path) -> None:
    done = run("pass")
    assert (done.returncode, done.stdout) == (0, "driven\nended\n")
    with Watchdog(60.0, tmp_path / "hung.txt") as watchdog:
        watchdog.reset()
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 50.0
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert (tmp_path / "hung.txt").read_text() == ""
