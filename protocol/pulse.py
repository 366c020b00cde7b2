"""The beat of arriving frames, to which the loop's grid locks its phase."""

from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue
from time import monotonic_ns
from typing import Protocol

NS_PER_S = 1_000_000_000
MAX_BEATS = 1000


class Beats(Protocol):
    """What the grid needs to know of a pulse."""

    def wait_until(self, deadline_ns: int) -> int | None: ...


class Pulse:
    """Wakes one waiting thread when a frame arrives; only the newest arrival is kept."""

    def __init__(self, now_ns: Callable[[], int] = monotonic_ns) -> None:
        self._now_ns = now_ns
        # A condition would wake the waiter into a lock that the notifier still holds.
        self._beats: SimpleQueue[int] = SimpleQueue()

    def beat(self, arrived_ns: int) -> None:
        """A frame has arrived; called from the bus, returns at once."""
        self._beats.put(arrived_ns)
        if self._beats.qsize() > MAX_BEATS:  # no reader: drop the oldest
            with suppress(Empty):
                self._beats.get_nowait()

    def wait_until(self, deadline_ns: int) -> int | None:
        """When the newest beat not yet taken arrived; None when none came by the deadline."""
        newest = self._newest(None)
        if newest is not None:
            return newest
        remaining_ns = deadline_ns - self._now_ns()
        if remaining_ns <= 0:
            return None
        try:
            return self._newest(self._beats.get(timeout=remaining_ns / NS_PER_S))
        except Empty:
            return None

    def _newest(self, newest_ns: int | None) -> int | None:
        with suppress(Empty):  # `beat` may drop the last one just after it was seen
            while not self._beats.empty():
                newest_ns = self._beats.get_nowait()
        return newest_ns
