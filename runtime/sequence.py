"""Order the frames of one sender by a count or a stamp in them.

A network may delay, reorder or repeat frames. A restarted sender begins its count again. The
distance distinguishes the two: a frame may be delayed by one second at most.
"""

from enum import Enum, auto
from typing import Final

from runtime.units import CONTROL_HZ, PERIOD_NS

MAX_LATE_TICKS: Final = round(CONTROL_HZ)
"""A frame at most this much older than the newest is late; an older one means a restart."""

MAX_LATE_NS: Final = MAX_LATE_TICKS * PERIOD_NS
"""The same limit for stamps."""


class Order(Enum):
    """The relation of a frame to the newest one of its sender."""

    NEWER = auto()
    REPEATED = auto()
    LATE = auto()
    RESTARTED = auto()


def order_of(number: int, newest: int, max_late: int, *, modulus: int = 0) -> Order:
    """Compare a count or a stamp with the newest one; a count wraps at `modulus`.

    A frame up to `max_late` behind is LATE: the network has reordered it. A frame farther behind
    belongs to a RESTARTED sender.
    """
    behind = newest - number
    if modulus:
        behind %= modulus
        if behind >= (modulus - 1) // 2:
            return Order.NEWER
    if behind <= 0:
        return Order.REPEATED if behind == 0 else Order.NEWER
    return Order.LATE if behind <= max_late else Order.RESTARTED


class SequenceTracker:
    """Tracks the newest count or stamp of one sender."""

    def __init__(self, max_late: int) -> None:
        self._max_late = max_late
        self._newest: int | None = None

    def take(self, number: int) -> Order:
        """Classify a frame; note its number unless it is late."""
        newest = self._newest
        order = Order.NEWER if newest is None else order_of(number, newest, self._max_late)
        if order is not Order.LATE:
            self._newest = number
        return order
