"""The kernel ends a process whose loop hangs, whether Python's lock is held or not."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from runtime.watchdog import Watchdog
from tests.support.each import each
from tests.support.until import PATIENCE_S

ROOT = Path(__file__).parents[3]
LOOP = """
import ctypes, signal, sys, time
from pathlib import Path
from runtime.watchdog import Watchdog
from tests.support.until import PATIENCE_S
trace = Path(sys.argv[2]) if len(sys.argv) > 2 else None
left_s = lambda: signal.getitimer(signal.ITIMER_REAL)[0]
with Watchdog(600.0, trace) as watchdog:
    before_s = 600.0
    for _ in watchdog.reset_by(range(4)):
        assert left_s() > before_s or before_s == 600.0
        while (before_s := left_s()) > 599.99: pass
    print("driven", flush=True)
    {hang}
print("ended")
"""
LAST_MOMENT = "signal.setitimer(signal.ITIMER_REAL, 0.1); "
HANGS = {
    "asleep": LAST_MOMENT + "time.sleep(600)",
    "holding Python's lock": LAST_MOMENT + "ctypes.PyDLL(None).sleep(600)",
    "busy": LAST_MOMENT + "[0 for _ in iter(int, 1)]",
}


def run(hang: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a loop, then `hang` in the last moment before the time is up."""
    return subprocess.run(
        [sys.executable, "-c", LOOP.format(hang=hang), "x", *words],
        cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip


@each("hang", HANGS.values())
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


def test_pipe_in_the_place_of_the_trace_holds_up_no_start(tmp_path: Path) -> None:
    trace = tmp_path / "hung.txt"
    os.mkfifo(trace)
    with Watchdog(600.0, trace):
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 0.0
