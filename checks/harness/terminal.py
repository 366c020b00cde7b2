"""A pseudo-terminal for a process, which records the bytes that are written to it and when.

It can be slow: then it reads at most so many bytes a second, like a serial line.
"""

import os
import signal
import subprocess
import sys
import termios
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Event, Lock, Thread
from time import monotonic_ns
from typing import Final, NamedTuple, Self

from checks.harness.processes import cpu_s
from runtime.units import NS_PER_S

CHUNK: Final = 65_536
SLOW_READ_S: Final = 0.05
ENDS_WITHIN_S: Final = 10.0
QUIET: Final = "\x11"
"""ctrl+q, which quits the ground station on every screen; twice while a robot drives."""
USUAL: Final[Mapping[str, str]] = {"TERM": "xterm-256color", "COLORTERM": "truecolor"}

UNWANTED: Final = ("COLUMNS", "LINES", "NO_COLOR", "PYTHONDONTWRITEBYTECODE", "PYTHONUNBUFFERED")
"""Set in test environments, but not by users."""


class TerminalReading(NamedTuple):
    """CPU time and bytes written by a process until now."""

    at_ns: int
    cpu_s: float
    written: int


@dataclass(frozen=True, slots=True)
class Spent:
    """CPU load and output rate between two readings."""

    cpu_percent: float
    kb_per_s: float


class Terminal:
    """`sidestep WORDS` on a terminal of its own, until the block ends."""

    def __init__(
        self,
        words: tuple[str, ...],
        size: tuple[int, int],
        environment: Mapping[str, str] | None = None,
        *,
        most_per_s: int | None = None,
    ) -> None:
        """Set `size` in columns and rows; read at most `most_per_s` bytes a second."""
        self._words, self._size = words, size
        self._environment = {**os.environ, **USUAL, **(environment or {})}
        for name in UNWANTED:
            self._environment.pop(name, None)
        self._pause_s = 0.0 if most_per_s is None else SLOW_READ_S
        self._chunk = CHUNK if most_per_s is None else max(1, round(most_per_s * SLOW_READ_S))
        self._lock, self._ended = Lock(), Event()
        self._written = 0
        self._seen = bytearray()
        self._arrivals: list[tuple[int, int]] = []
        self.begun_ns = 0

    def __enter__(self) -> Self:
        self._end, inner = os.openpty()
        columns, rows = self._size
        termios.tcsetwinsize(inner, (rows, columns))
        self.begun_ns = monotonic_ns()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "sidestep", *self._words],
            stdin=inner,
            stdout=inner,
            stderr=inner,
            env=self._environment,
            start_new_session=True,
        )
        os.close(inner)
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._pause_s, self._chunk = 0.0, CHUNK
        self.type(QUIET + QUIET)
        try:
            self._process.wait(ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._ended.set()
        self._reader.join(ENDS_WITHIN_S)
        os.close(self._end)

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    def type(self, keys: str) -> int:
        """Press keys and return the monotonic time of that in ns."""
        at_ns = monotonic_ns()
        os.write(self._end, keys.encode())
        return at_ns

    def resize(self, size: tuple[int, int]) -> None:
        """Set the size in columns and rows, and notify the app as a terminal emulator does."""
        columns, rows = size
        termios.tcsetwinsize(self._end, (rows, columns))
        os.kill(self.pid, signal.SIGWINCH)  # it is not the terminal's controlling process

    @contextmanager
    def slow(self, most_per_s: int) -> Iterator[None]:
        """Read at most so many bytes a second until the block ends."""
        self._pause_s, self._chunk = SLOW_READ_S, max(1, round(most_per_s * SLOW_READ_S))
        try:
            yield
        finally:
            self._pause_s, self._chunk = 0.0, CHUNK

    def reading(self) -> TerminalReading:
        """Read the CPU time and the number of bytes written."""
        with self._lock:
            return TerminalReading(monotonic_ns(), cpu_s(self.pid), self._written)

    def spent(self, seconds: float) -> Spent:
        """Return load and output rate over the next so many seconds."""
        before = self.reading()
        Event().wait(seconds)
        after = self.reading()
        took_s = (after.at_ns - before.at_ns) / NS_PER_S
        return Spent(
            100.0 * (after.cpu_s - before.cpu_s) / took_s,
            (after.written - before.written) / took_s / 1e3,
        )

    def shown(self, words: str, patience_s: float) -> int:
        """Return when the bytes that complete `words` were read, after the last `forget`.

        Raise RuntimeError when they do not arrive in time.
        """
        deadline_ns, pause = monotonic_ns() + round(patience_s * NS_PER_S), Event()
        is_over = False
        while (found_ns := self._found(words.encode())) is None:
            if monotonic_ns() > deadline_ns or is_over:
                raise RuntimeError(f"not on the screen: {words!r}; last: {self.text()[-300:]!r}")
            pause.wait(0.002)
            is_over = not self._reader.is_alive()
        return found_ns

    @property
    def first_ns(self) -> int:
        """The time at which the first bytes after the last `forget` were read."""
        with self._lock:
            return self._arrivals[0][0]

    def text(self) -> str:
        """Return the output after the last `forget`."""
        with self._lock:
            return self._seen.decode(errors="replace")

    def forget(self) -> None:
        """Forget the output so far."""
        with self._lock:
            self._seen.clear()
            self._arrivals.clear()

    def _found(self, words: bytes) -> int | None:
        with self._lock:
            ends = self._seen.find(words) + len(words)
            if ends < len(words):
                return None
            return next(at_ns for at_ns, upto in self._arrivals if upto >= ends)

    def _read(self) -> None:
        while not self._ended.is_set():
            try:
                data = os.read(self._end, self._chunk)
            except OSError:  # the process has ended
                return
            with self._lock:
                self._written += len(data)
                self._seen += data
                self._arrivals.append((monotonic_ns(), len(self._seen)))
            if self._pause_s:
                self._ended.wait(self._pause_s)
