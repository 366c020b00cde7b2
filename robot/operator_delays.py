"""Detect frames of operators that are late compared with the sender's usual delay."""

from collections import OrderedDict
from typing import Final

MAX_EXTRA_NS: Final = 200_000_000
"""A frame may be later than is usual for its sender by this much."""

SPAN_NS: Final = 5_000_000_000
"""The usual delay is the minimum over this time span and the one before it."""

MAX_SENDERS: Final = 16


class UsualDelay:
    """The minimum delay of one sender over the last two time spans."""

    __slots__ = ("_before_ns", "_least_ns", "_since_ns")

    def __init__(self, delay_ns: int, now_ns: int) -> None:
        self._before_ns = self._least_ns = delay_ns
        self._since_ns = now_ns

    def update(self, delay_ns: int, now_ns: int) -> int:
        """Include a delay and return the minimum."""
        if now_ns - self._since_ns >= SPAN_NS:
            self._before_ns, self._least_ns = self._least_ns, delay_ns
            self._since_ns = now_ns
        self._least_ns = min(self._least_ns, delay_ns)
        return min(self._least_ns, self._before_ns)


class DelayFilter:
    """Detects late frames by sender; only the most recent senders are kept."""

    def __init__(self) -> None:
        self._usual: OrderedDict[str, UsualDelay] = OrderedDict()

    def is_late(self, sender: str, sent_ns: int, arrived_ns: int) -> bool:
        """Return whether a frame is more than MAX_EXTRA_NS later than usual for its sender."""
        delay_ns = arrived_ns - sent_ns
        usual = self._usual.get(sender)
        if usual is None:
            usual = self._usual[sender] = UsualDelay(delay_ns, arrived_ns)
        self._usual.move_to_end(sender)
        if len(self._usual) > MAX_SENDERS:
            self._usual.popitem(last=False)
        return delay_ns - usual.update(delay_ns, arrived_ns) > MAX_EXTRA_NS
