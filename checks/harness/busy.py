"""Keep the processors busy: processes that only compute, at normal priority, until the block ends.

Each one has a session of its own, because Linux may share the processors between sessions instead
of processes. Each one also ends when the process that started it ends in any way.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ground.launch.child_command import die_with_parent


def use_normal_priority() -> None:
    """Leave the idle and batch scheduling classes and a nice session, as far as this user may."""
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text("0")


@contextmanager
def busy(processes: int) -> Iterator[list[int]]:
    """Run so many busy processes; yield their process ids."""
    words = [sys.executable, "-m", "checks.harness.busy", str(os.getpid())]
    started: list[subprocess.Popen[bytes]] = []
    try:
        started.extend(
            subprocess.Popen(words, start_new_session=True) for _ in range(processes)
        )  # one by one, so that all are known when this is interrupted
        yield [process.pid for process in started]
    finally:
        for process in started:
            process.kill()
        for process in started:
            process.wait()


def main(parent: int) -> None:
    """Compute until killed, or until the process `parent` ends."""
    use_normal_priority()
    if die_with_parent(parent):
        while True:
            pass


if __name__ == "__main__":
    main(int(sys.argv[1]))
