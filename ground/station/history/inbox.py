"""What the bus's threads leave for the station: one bounded ring, emptied at each poll."""

from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

SIZE: Final = 8192


class Arrival(NamedTuple):
    """One frame of one topic, and when it arrived."""

    path: str
    frame: bytes
    arrived_ns: int


class Inbox:
    """The oldest give way when nobody empties it; both ends of a deque may be used at once."""

    def __init__(self, size: int = SIZE) -> None:
        self._ring: deque[Arrival] = deque(maxlen=size)

    def taker(self, path: str) -> Callable[[str, bytes, int], None]:
        """A handler for the frames of one topic; runs in the bus's thread and only stores."""
        put = self._ring.append

        def take(_key: str, frame: bytes, arrived_ns: int) -> None:
            put(Arrival(path, frame, arrived_ns))

        return take

    def drain(self) -> tuple[list[Arrival], bool]:
        """All that came since the last time, and whether some of it had to give way."""
        ring = self._ring
        overflowed = len(ring) == ring.maxlen
        return [ring.popleft() for _ in range(len(ring))], overflowed
