"""Time limits for processes: one whose loop hangs is ended, and a busy machine stretches waits.

Each pass of a loop resets an interval timer. It needs no Python code to expire, so it works even
while the interpreter's lock is held for ever. The default action of SIGALRM then ends the process,
and the launcher sees this signal. A process that is suspended for longer ends when it is resumed.
The kernel ignores the signal for process 1 of a container: such a container needs an init process.

A process that waits for another one cannot see whether that one hangs or only waits for a
processor. A limit for such a wait therefore counts less while more threads are ready to run than
there are processors. Limits that stop a robot are never stretched.
"""

import faulthandler
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from time import monotonic_ns
from typing import IO, Final, Protocol, Self, TypeVar

from runtime.clock import Clock, WallClock
from runtime.units import NS_PER_MS, NS_PER_S

HUNG_S: Final = 5.0
HANGS: Final = f"hung (its loop did not run for {HUNG_S:g} s)"
"""Describes a process that the watchdog has ended."""

RESET_NS: Final = 250 * NS_PER_MS
"""The timer is restarted at most this often: a system call in each cycle costs more than it gains.
"""

T = TypeVar("T")


class SignOfLife(Protocol):
    """What a loop resets while it runs."""

    def reset(self) -> None:
        """Restart the timer."""

    def reset_by(self, rounds: Iterable[T]) -> Iterator[T]:
        """Yield the items, and reset the watchdog for each."""
        for one in rounds:
            self.reset()
            yield one


class Watchdog(SignOfLife):
    """Ends the process `patience_s` after the last reset, within the block, in the main thread.

    It may do so `RESET_NS` earlier.

    `trace` is a file that then receives the stack traces of all threads, if it can be written.
    """

    def __init__(self, patience_s: float = HUNG_S, trace: Path | None = None) -> None:
        self._patience_s = patience_s
        self._trace = trace
        self._file: IO[str] | None = None
        self._reset_ns: int | None = None

    def __enter__(self) -> Self:
        if self._trace is not None:
            with suppress(OSError):  # not blocking: a pipe of that name has no reader
                flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NONBLOCK | os.O_CLOEXEC
                self._file = open(os.open(self._trace, flags, 0o666), "w", encoding="utf-8")
        if self._file is not None:
            faulthandler.register(signal.SIGALRM, self._file, all_threads=True, chain=True)
        self._reset_ns = None
        self.reset()
        return self

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        if self._file is not None:
            faulthandler.unregister(signal.SIGALRM)
            self._file.close()

    def reset(self) -> None:
        """Restart the timer, unless that was done less than `RESET_NS` ago."""
        now_ns = monotonic_ns()
        if self._reset_ns is None or now_ns - self._reset_ns >= RESET_NS:
            self._reset_ns = now_ns
            signal.setitimer(signal.ITIMER_REAL, self._patience_s)

    def divided(self, loops: int) -> list[SignOfLife]:
        """Return a part for each of several loops: together they reset this watchdog.

        The timer restarts when each loop has given a sign, so a loop that hangs ends the process.
        """
        parts: set[SignOfLife] = set()
        return [self] if loops == 1 else [WatchdogPart(self, parts, loops) for _ in range(loops)]


class WatchdogPart(SignOfLife):
    """The part of a watchdog that one of several loops resets, each in any thread."""

    def __init__(self, whole: Watchdog, signs: set[SignOfLife], loops: int) -> None:
        self._whole, self._signs, self._loops = whole, signs, loops

    def reset(self) -> None:
        """Give a sign; the last loop to do so restarts the timer."""
        self._signs.add(self)
        if len(self._signs) == self._loops:
            self._signs.clear()
            self._whole.reset()


MAX_SLOWDOWN: Final = 5.0
"""A limit is stretched at most by this factor, so that a process that hangs is still found."""
BUSY: Final = 2.0
"""From this factor on messages name the load."""
RESOLUTION_NS: Final = 10 * NS_PER_MS
"""The load is read at most this often."""
LOAD: Final = Path("/proc/loadavg")
PROCESSES: Final = Path("/proc")


def slowdown() -> float:
    """Return how much longer than on an idle machine a process may need now, from 1 to 5.

    This is the number of threads that are ready to run, for each processor; or the load of the last
    minute where the system does not count them; or 1 where it reports neither.
    """
    ready = 0.0
    try:
        ready = float(LOAD.read_text(encoding="ascii").split()[3].partition("/")[0])
    except (OSError, ValueError, IndexError):
        with suppress(OSError, AttributeError):
            ready = os.getloadavg()[0]
    return min(MAX_SLOWDOWN, max(1.0, ready / (os.cpu_count() or 1)))


def slowdown_in(clock: Clock) -> Callable[[], float]:
    """Return the measure for waits by this clock: only wall time depends on the load."""
    return slowdown if isinstance(clock, WallClock) else lambda: 1.0


def load_words(factor: float) -> str:
    """Return that the machine is busy, for the end of a message; empty below a factor of 2."""
    return f"; this machine is busy, {factor:.0f} times slower than idle" if factor >= BUSY else ""


class Patience:
    """A time limit for another process, of which a busy machine uses up less.

    Wait for at most `left_s()`, check the condition, and ask again until it is 0. Time beyond the
    wait that was asked for does not count: then this process itself was delayed.
    """

    def __init__(
        self,
        limit_ns: int,
        now_ns: Callable[[], int] = monotonic_ns,
        slowdown: Callable[[], float] = slowdown,
    ) -> None:
        self.factor = 1.0
        """The largest slowdown that was measured."""
        self._left_ns = limit_ns
        self._least_ns = limit_ns // 20  # a shorter rest is not worth another wait
        self._now_ns = now_ns
        self._slowdown = slowdown
        self._at_ns = now_ns()

    def left_ns(self) -> int:
        """Return how long to wait next, in ns; 0 when the limit is used up."""
        now_ns = self._now_ns()
        passed_ns = now_ns - self._at_ns
        if passed_ns < min(RESOLUTION_NS, self._left_ns):
            return self._left_ns - passed_ns
        factor = self._slowdown()
        self.factor = max(self.factor, factor)
        self._at_ns = now_ns
        self._left_ns -= max(1, int(min(passed_ns, self._left_ns) / factor))
        if self._left_ns <= self._least_ns:
            self._left_ns = 0
        return self._left_ns

    def left_s(self) -> float:
        """Return how long to wait next, in seconds; 0.0 when the limit is used up."""
        return self.left_ns() / NS_PER_S


def queued_ns(pid: int) -> dict[str, int]:
    """Return how long each thread of a process has waited for a processor since its start.

    Empty if the process has ended or the system does not measure it.
    """
    found = {}
    with suppress(OSError):
        for thread in (PROCESSES / str(pid) / "task").iterdir():
            with suppress(OSError, ValueError, IndexError):
                found[thread.name] = int((thread / "schedstat").read_text().split()[1])
    return found


def starved_ns(before: Mapping[str, int], after: Mapping[str, int]) -> int:
    """Return the longest wait of a thread for a processor between two results of `queued_ns`.

    A process that hangs in a lock or is suspended does not wait for one.
    """
    return max((ns - before.get(thread, 0) for thread, ns in after.items()), default=0)
