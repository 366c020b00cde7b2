"""The effects of a bad line: seeded loss, delay, jitter and reordering, without I/O."""

from heapq import heappop, heappush
from random import Random
from typing import Final, NamedTuple

from runtime.units import NS_PER_MS

OVERTAKEN_NS: Final = 30 * NS_PER_MS
"""Extra delay of a reordered datagram, so that later datagrams arrive before it."""


class Impairment(NamedTuple):
    """The properties of one direction; probabilities are between 0 and 1."""

    loss: float = 0.0
    delay_ns: int = 0
    jitter_ns: int = 0
    reordered: float = 0.0


PERFECT: Final = Impairment()
POOR: Final = Impairment(0.2, 50 * NS_PER_MS, 20 * NS_PER_MS, 0.1)
"""20 % loss, 50 ms delay, and every tenth datagram out of order."""


class ImpairedLine:
    """One direction. Equal datagrams with an equal seed have equal results."""

    def __init__(self, impairment: Impairment, seed: int) -> None:
        self.lost = self.passed = 0
        self._impairment = impairment
        self._random = Random(seed)
        self._number = 0
        self._in_order_ns = 0
        self._waiting: list[tuple[int, int, bytes]] = []

    @property
    def due_ns(self) -> int | None:
        """When the next datagram arrives; None if none is under way."""
        return self._waiting[0][0] if self._waiting else None

    def put(self, data: bytes, now_ns: int) -> None:
        """Send a datagram into the line."""
        self._number += 1
        # The same number of draws for each, so that one property does not change the others.
        loss, jitter, reordered = (self._random.random() for _ in range(3))
        if loss < self._impairment.loss:
            self.lost += 1
            return
        due_ns = now_ns + self._impairment.delay_ns + round(jitter * self._impairment.jitter_ns)
        if reordered < self._impairment.reordered:
            due_ns += OVERTAKEN_NS
        else:  # jitter alone does not change the order
            due_ns = self._in_order_ns = max(due_ns, self._in_order_ns)
        heappush(self._waiting, (due_ns, self._number, data))

    def take(self, now_ns: int) -> list[bytes]:
        """Return the datagrams that have arrived, in the order of their arrival."""
        found = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            found.append(heappop(self._waiting)[2])
        self.passed += len(found)
        return found
