"""Our own processes, started for a measurement and ended after it."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager


class Started:
    """A process that has said that it is there; `said` is what it wrote until then."""

    def __init__(self, child: "subprocess.Popen[str]", ready: str) -> None:
        self.pid = child.pid
        self.said: list[str] = []
        assert child.stderr is not None
        for line in child.stderr:
            self.said.append(line.rstrip())
            if ready in line:
                return
        raise RuntimeError("a process ended before it was ready: " + " ".join(self.said))


@contextmanager
def sidestep(*arguments: str, ready: str) -> Iterator[Started]:
    """`sidestep ...`, until the block ends; `ready` is in the line that says it is there."""
    command = [sys.executable, "-m", "sidestep", *arguments]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as child:
        try:
            yield Started(child, ready)
        finally:
            child.terminate()
