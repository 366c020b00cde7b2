"""Redirect all output but that of the app to a log file, while the app is open."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedWriter, FileIO, TextIOWrapper
from pathlib import Path
from typing import Final

OUTPUTS: Final = (1, 2)
MOST_BYTES: Final = 1_000_000


class TerminalText(TextIOWrapper):
    """A text stream to the terminal that is `busy` from a write until the flush after it.

    Textual writes from its own thread, and flushes when nothing else waits to be written.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__(BufferedWriter(FileIO(descriptor, "w")), encoding="utf-8")
        self.busy = False

    def write(self, text: str) -> int:
        """Write a text."""
        self.busy = True
        return super().write(text)

    def flush(self) -> None:
        """Flush, which blocks until the terminal has taken everything."""
        super().flush()
        self.busy = False


@contextmanager
def capture_output(log: Path) -> Iterator[TerminalText]:
    """Redirect standard output and error to the log, and yield the stream of the screen.

    Native libraries write to the file descriptors, so these are exchanged. Textual draws through
    `sys.__stderr__` and asks `sys.__stdout__` for the size of the terminal (a browser's driver
    writes there); both keep the terminal.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    kept = {number: os.dup(number) for number in OUTPUTS}
    before = sys.__stdout__, sys.__stderr__
    sink = open_log(log)
    screens = [TerminalText(os.dup(kept[number])) for number in OUTPUTS]
    for number in OUTPUTS:
        os.dup2(sink, number)
    vars(sys).update(__stdout__=screens[0], __stderr__=screens[1])
    try:
        yield screens[1]
    finally:
        vars(sys).update(__stdout__=before[0], __stderr__=before[1])
        sys.stdout.flush()
        sys.stderr.flush()
        for screen in screens:
            screen.close()
        for number, saved in kept.items():
            os.dup2(saved, number)
            os.close(saved)
        os.close(sink)


def open_log(log: Path) -> int:
    """Open the log file; delete it first when it is too long.

    Open /dev/null when it cannot be written.
    """
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        if log.exists() and log.stat().st_size > MOST_BYTES:
            log.unlink()
        return os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    except OSError:
        return os.open(os.devnull, os.O_WRONLY)
