"""How busy this machine is, and time limits that a busy machine does not use up.

A process that waits for another one cannot see whether that one hangs or only waits for a
processor. A limit for such a wait therefore counts less while more threads are ready to run than
there are processors. Limits that stop a robot are never stretched.
"""

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from time import monotonic_ns
from typing import Final

from runtime.clock import Clock, WallClock
from runtime.units import NS_PER_MS, NS_PER_S

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
