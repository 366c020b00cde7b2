"""Wait for events from other threads: a wake-up, and a pulse of arriving frames.

The control loop locks the phase of its grid to the pulse.
"""

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from threading import Lock
from time import monotonic_ns
from typing import Protocol

from runtime.units import NS_PER_S


class WakeUp:
    """Wakes one waiting thread.

    A wake-up without a waiting thread is kept; several count as one. Store the data before `wake`:
    the thread reads it after `wait`.

    `SimpleQueue.get` is unsuitable. Before Python 3.13 it waits for ever if a signal interrupts it
    and the handler returns after the deadline. A condition would wake the waiting thread into a
    lock that the notifier still holds.
    """

    def __init__(self) -> None:
        self._held = Lock()
        self._held.acquire()

    def wake(self) -> None:
        """Wake the thread; returns at once, from any thread and from a signal handler."""
        if self._held.locked():
            with suppress(RuntimeError):  # another thread has just released it
                self._held.release()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Return True if woken, False after the timeout."""
        return self._held.acquire(timeout=-1.0 if timeout_s is None else max(0.0, timeout_s))


class PulseSource(Protocol):
    """A source of frame arrivals for the grid."""

    def wait_until(self, deadline_ns: int) -> int | None:
        """Return the time of an arrival, or None if there is none before the deadline."""


class Pulse:
    """Wakes one waiting thread when a frame arrives; only the newest arrival is kept."""

    def __init__(self, now_ns: Callable[[], int] = monotonic_ns) -> None:
        self._now_ns = now_ns
        self._newest_ns: deque[int] = deque(maxlen=1)
        self._arrival = WakeUp()

    def beat(self, arrived_ns: int) -> None:
        """Note the arrival of a frame; called from the bus, returns at once."""
        self._newest_ns.append(arrived_ns)
        self._arrival.wake()

    def wait_until(self, deadline_ns: int) -> int | None:
        """Return the newest arrival that was not yet returned, or None at the deadline."""
        while (arrived_ns := self._taken()) is None:
            remaining_s = (deadline_ns - self._now_ns()) / NS_PER_S
            if remaining_s <= 0 or not self._arrival.wait(remaining_s):
                return None
        return arrived_ns

    def _taken(self) -> int | None:
        return self._newest_ns.popleft() if self._newest_ns else None
