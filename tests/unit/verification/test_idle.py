"""A command in the idle class runs to its end, and ends with the process that started it."""

import os
import signal
import subprocess
import sys

from tests.support.until import until

IDLE = (sys.executable, "-m", "verification.idle", sys.executable, "-c")
SHOWS = "import os; print(os.sched_getscheduler(0) == os.SCHED_IDLE, os.getsid(0) == os.getpid())"
WAITS = "import os, sys; print(os.getpid(), flush=True); sys.stdin.read()"
PARENT = """
import subprocess, sys
subprocess.run(sys.argv[1:])
"""


def test_command_is_idle_and_has_a_session_of_its_own() -> None:
    done = subprocess.run([*IDLE, SHOWS], capture_output=True, text=True, check=True)
    assert done.stdout == "True True\n"


def test_exit_code_is_that_of_the_command() -> None:
    assert subprocess.run([*IDLE, "raise SystemExit(3)"], check=False).returncode == 3


def test_command_ends_with_the_process_that_started_it() -> None:
    words = [sys.executable, "-c", PARENT, *IDLE, WAITS]
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdin=pipe, stdout=pipe, text=True) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
        parent.wait()
        until(lambda: not os.path.exists(f"/proc/{pid}/exe"), what="its end")
