"""Ends a process whose loop hangs: the kernel's alarm clock, wound up again by every round.

No Python has to run for it to strike, so it does where Python's own lock is held for ever. What
it leaves is the signal's default action, the end: whoever started the process sees SIGALRM. A
process that was stopped for longer ends when it is let go. As process 1 of a container it would be
spared by the kernel: such a container needs an init.
"""

import faulthandler
import signal
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Final, Self, TypeVar

HUNG_S: Final = 5.0
HANGS: Final = f"hung (its loop did not run for {HUNG_S:g} s)"
"""What is said of a process that it has ended."""

T = TypeVar("T")


class Watchdog:
    """Strikes within the block, `patience_s` after it was last wound up; only in the main thread.

    `trace` is a file that then gets the place where each thread hung, for developers, if it can be
    written.
    """

    def __init__(self, patience_s: float = HUNG_S, trace: Path | None = None) -> None:
        self._patience_s = patience_s
        self._trace = trace
        self._file: IO[str] | None = None

    def __enter__(self) -> Self:
        if self._trace is not None:
            with suppress(OSError):
                self._file = self._trace.open("w", encoding="utf-8")
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
        """The loop runs."""
        signal.setitimer(signal.ITIMER_REAL, self._patience_s)

    def reset_by(self, rounds: Iterable[T]) -> Iterator[T]:
        """The same rounds, each of which winds it up."""
        for one in rounds:
            self.reset()
            yield one
