"""The order in which one sender made its frames, by a count or a stamp that they carry.

A network may deliver a frame late, after a newer one, or twice. A sender that was restarted counts
anew. The two are told apart by the distance: at most one second may pass on the way.
"""

from enum import Enum, auto
from typing import Final

from runtime.timing import CONTROL_HZ, PERIOD_NS

MAX_LATE_TICKS: Final = round(CONTROL_HZ)
"""A frame at most so many control periods older than the newest is late; an older one restarted."""

MAX_LATE_NS: Final = MAX_LATE_TICKS * PERIOD_NS
"""The same for stamps."""


class Order(Enum):
    """How a frame relates to the newest one of its sender."""

    NEWER = auto()
    REPEATED = auto()
    LATE = auto()
    RESTARTED = auto()


def order_of(number: int, newest: int, max_late: int, *, modulus: int = 0) -> Order:
    """Compare a count or a stamp with the newest one; `modulus` is where a count begins at 0 again.

    A frame up to `max_late` behind is LATE: a newer one has overtaken it on the way. One farther
    behind is of a sender that has RESTARTED.
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
    """Keeps the newest count or stamp of one sender."""

    def __init__(self, max_late: int) -> None:
        self._max_late = max_late
        self._newest: int | None = None

    def take(self, number: int) -> Order:
        """Classify a frame, and go on from it unless it is late."""
        newest = self._newest
        order = Order.NEWER if newest is None else order_of(number, newest, self._max_late)
        if order is not Order.LATE:
            self._newest = number
        return order
