"""End a process whose loop hangs, by an interval timer that each pass of the loop resets.

The timer needs no Python code to expire, so it works even while the interpreter's lock is held for
ever. The default action of SIGALRM then ends the process, and the launcher sees this signal. A
process that is suspended for longer ends when it is resumed. The kernel ignores the signal for
process 1 of a container: such a container needs an init process.
"""

import faulthandler
import os
import signal
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Final, Self, TypeVar

HUNG_S: Final = 5.0
HANGS: Final = f"hung (its loop did not run for {HUNG_S:g} s)"
"""Describes a process that the watchdog has ended."""

T = TypeVar("T")


class Watchdog:
    """Ends the process `patience_s` after the last reset, within the block, in the main thread.

    `trace` is a file that then receives the stack traces of all threads, if it can be written.
    """

    def __init__(self, patience_s: float = HUNG_S, trace: Path | None = None) -> None:
        self._patience_s = patience_s
        self._trace = trace
        self._file: IO[str] | None = None

    def __enter__(self) -> Self:
        if self._trace is not None:
            with suppress(OSError):  # not blocking: a pipe of that name has no reader
                flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NONBLOCK | os.O_CLOEXEC
                self._file = open(os.open(self._trace, flags, 0o666), "w", encoding="utf-8")
        if self._file is not None:
            faulthandler.register(signal.SIGALRM, self._file, all_threads=True, chain=True)
        self.reset()
        return self

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        if self._file is not None:
            faulthandler.unregister(signal.SIGALRM)
            self._file.close()

    def reset(self) -> None:
        """Restart the timer."""
        signal.setitimer(signal.ITIMER_REAL, self._patience_s)

    def reset_by(self, rounds: Iterable[T]) -> Iterator[T]:
        """Yield the items, and reset the watchdog for each."""
        for one in rounds:
            self.reset()
            yield one
