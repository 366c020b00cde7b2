"""Pass frames from the bus's threads to the station in a bounded ring."""

from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

SIZE: Final = 8192


class ReceivedFrame(NamedTuple):
    """A frame of a topic with its time of arrival."""

    path: str
    frame: bytes
    arrived_ns: int


class Inbox:
    """A ring that drops the oldest frames when full; both ends may be used concurrently."""

    def __init__(self, size: int = SIZE) -> None:
        self._ring: deque[ReceivedFrame] = deque(maxlen=size)

    def taker(self, path: str) -> Callable[[str, bytes, int], None]:
        """Return a handler for a topic; it runs in the bus's thread and only stores frames."""
        put = self._ring.append

        def take(_key: str, frame: bytes, arrived_ns: int) -> None:
            put(ReceivedFrame(path, frame, arrived_ns))

        return take

    def drain(self) -> tuple[list[ReceivedFrame], bool]:
        """Return all frames since the last call, and whether some of them were dropped."""
        ring = self._ring
        overflowed = len(ring) == ring.maxlen
        return [ring.popleft() for _ in range(len(ring))], overflowed
