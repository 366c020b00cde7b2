"""Our own processes, started for a measurement and ended after it, and free ports for them."""

import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager


class Started:
    """A process that has said that it is there; `said` is what it wrote until then.

    What it writes later is read and dropped, so that it never waits for a reader.
    """

    def __init__(self, child: "subprocess.Popen[str]", ready: str) -> None:
        self.pid = child.pid
        self.said: list[str] = []
        assert child.stderr is not None
        for line in child.stderr:
            self.said.append(line.rstrip())
            if ready in line:
                break
        else:
            raise RuntimeError("a process ended before it was ready: " + " ".join(self.said))
        self._reader = threading.Thread(target=deque, args=(child.stderr, 0), daemon=True)
        self._reader.start()

    def join(self) -> None:
        """Wait until it has written its last."""
        self._reader.join()


@contextmanager
def sidestep(*arguments: str, ready: str) -> Iterator[Started]:
    """`sidestep ...`, until the block ends; `ready` is in the line that says it is there."""
    command = [sys.executable, "-m", "sidestep", *arguments]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as child:
        started = None
        try:
            started = Started(child, ready)
            yield started
        finally:
            child.terminate()
            if started is not None:
                started.join()


def free_port() -> int:
    """Return a port of loopback that no process uses at the moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port
