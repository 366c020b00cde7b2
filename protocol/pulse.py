"""The beat of arriving frames, to which the loop's grid locks its phase."""

import threading
from collections.abc import Callable
from time import monotonic_ns
from typing import Protocol

NS_PER_S = 1_000_000_000


class Beats(Protocol):
    """What the grid needs to know of a pulse."""

    def wait_until(self, deadline_ns: int) -> int | None: ...


class Pulse:
    """Wakes one waiting thread when a frame arrives; only the newest arrival is kept."""

    def __init__(self, now_ns: Callable[[], int] = monotonic_ns) -> None:
        self._now_ns = now_ns
        self._changed = threading.Condition()
        self._arrived_ns: int | None = None

    def beat(self, arrived_ns: int) -> None:
        """A frame has arrived; called from the bus, returns at once."""
        with self._changed:
            self._arrived_ns = arrived_ns
            self._changed.notify()

    def wait_until(self, deadline_ns: int) -> int | None:
        """When the newest beat not yet taken arrived; None when none came by the deadline."""
        with self._changed:
            while self._arrived_ns is None:
                remaining_ns = deadline_ns - self._now_ns()
                if remaining_ns <= 0:
                    return None
                self._changed.wait(remaining_ns / NS_PER_S)
            arrived_ns, self._arrived_ns = self._arrived_ns, None
            return arrived_ns
