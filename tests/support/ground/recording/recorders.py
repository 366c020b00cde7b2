"""Recorders without processes: they print the names of their files, and lock them."""

import fcntl
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import cast

from ground.launch.child_processes import Child, Children
from ground.launch.recorder_files import created_line
from ground.recording.log_reader import robot_in
from runtime.clock import ManualClock


class PrintingChildren(Children):
    """Children without processes, whose output a test writes."""

    def __init__(self) -> None:
        super().__init__(ManualClock())
        self._pids = count(7)

    def start(self, role: str, arguments: Sequence[str]) -> None:
        process = SimpleNamespace(pid=next(self._pids), poll=lambda: None)
        output = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `stop`
        child = Child(role, cast("subprocess.Popen[bytes]", process), output)
        self._children.append(child)

    def print_name(self, log: Path, before: str = "") -> None:
        """Let the newest recorder print its line, after another text."""
        output = self._children[-1].output
        output.write(f"{before}{created_line(robot_in(log), log)}\n".encode())
        output.flush()

    def stop(self) -> None:
        for child in self._children:
            child.output.close()
        self._children.clear()


@contextmanager
def written(*paths: Path) -> Iterator[None]:
    """Hold the lock of a writer on these files."""
    with ExitStack() as held:
        for path in paths:
            file = held.enter_context(path.open("rb"))
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


@contextmanager
def printing_children() -> Iterator[PrintingChildren]:
    """Provide such children and close their outputs."""
    children = PrintingChildren()
    try:
        yield children
    finally:
        children.stop()
