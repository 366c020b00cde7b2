"""The messages that a vehicle can send: the builder and the default rate of each.

A service adds its messages in its constructor. The scheduler sends them, and REQUEST_MESSAGE builds
one at once; both share the messages that were built in a round.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

from gateways.mavlink.dialect import MavMessage, mavlink

Build = Callable[[int], Sequence[MavMessage]]
"""Returns the messages of the present round, given its time; none if the values are missing."""
Prepare = Callable[[Callable[[], None], int], None]
"""Asks the robot for missing values, and calls back when it has answered or is silent."""
FRAME_BYTES: Final = 12 + 13
"""Header, checksum and signature."""


class Source(NamedTuple):
    """One kind of message.

    `rate_hz` is the default rate, and `slow_hz` that on a line too slow for all defaults; at 0 it
    is sent only on request. `group` is the MAV_DATA_STREAM of REQUEST_DATA_STREAM to which it
    belongs. `copies` is the number of messages per build. `prepare` obtains missing values.
    """

    number: int
    build: Build
    rate_hz: float = 0.0
    slow_hz: float = 0.0
    group: int | None = None
    copies: int = 1
    prepare: Prepare | None = None

    @property
    def largest_bytes(self) -> int:
        """The size of the frames of one build, at most."""
        payload: int = mavlink.mavlink_map[self.number].unpacker.size
        return self.copies * (payload + FRAME_BYTES)


class Catalogue:
    """The sources of one vehicle by the id of their message."""

    def __init__(self) -> None:
        self._sources: dict[int, Source] = {}
        self._built: dict[int, Sequence[MavMessage]] = {}
        self._built_ns = -1

    def add(self, source: Source) -> None:
        """Add a source, or replace that of the same message."""
        self._sources[source.number] = source

    def find(self, number: int) -> Source | None:
        """Return the source of a message."""
        return self._sources.get(number)

    def is_stream(self, number: int) -> bool:
        """Return whether a message is sent periodically, so that one may be dropped."""
        source = self._sources.get(number)
        return source is not None and source.rate_hz > 0

    def __iter__(self) -> Iterator[Source]:
        return iter(self._sources.values())

    def build(self, number: int, now_ns: int) -> Sequence[MavMessage]:
        """Return the messages of this round; several clients share one build."""
        if now_ns != self._built_ns:
            self._built.clear()
            self._built_ns = now_ns
        found = self._built.get(number)
        if found is None:
            found = self._built[number] = self._sources[number].build(now_ns)
        return found
