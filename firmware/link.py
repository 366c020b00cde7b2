"""Find MAVLink frames in a stream of bytes, without I/O.

Bytes that belong to no frame are skipped. An incomplete frame is skipped as soon as a whole frame
follows its start, so that a damaged length never blocks the stream.
"""

from collections.abc import Iterator

from protocol.wire.codec import HEADER_SIZE, MAGIC_BYTE, OUTSIDE, WIRE_OF_ID, decode
from protocol.wire.message import Message
from runtime.errors import RemoteError


class FrameStream:
    """Collects bytes and returns whole messages; `skipped` counts the bytes of no frame."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.skipped = 0

    @property
    def waiting(self) -> int:
        """Bytes of an incomplete frame."""
        return len(self._bytes)

    def feed(self, received: bytes) -> Iterator[Message]:
        """Yield the messages that these bytes complete."""
        self._bytes += received
        start = self._bytes.find(MAGIC_BYTE)
        while start >= 0:
            message, size = self._message_at(start)
            if message is None:
                start = self._bytes.find(MAGIC_BYTE, start + 1)
                continue
            self._skip(start)
            del self._bytes[:size]
            yield message
            start = self._bytes.find(MAGIC_BYTE)
        self._skip(self._first_unfinished())

    def _message_at(self, start: int) -> tuple[Message | None, int]:
        """Return the message and the size of a frame; no message if it is incomplete or invalid."""
        size = self._size_at(start)
        if size == 0 or start + size > len(self._bytes):
            return None, size
        try:
            return decode(bytes(self._bytes[start : start + size])).message, size
        except RemoteError:
            return None, size

    def _size_at(self, start: int) -> int:
        """Return the size of a frame by its header; 0 if the header has not arrived."""
        return self._bytes[start + 1] + OUTSIDE if start + 1 < len(self._bytes) else 0

    def _first_unfinished(self) -> int:
        """Return the first place at which a frame may begin whose rest has not arrived."""
        start = self._bytes.find(MAGIC_BYTE)
        while start >= 0:
            size = self._size_at(start)
            is_incomplete = size == 0 or start + size > len(self._bytes)
            if is_incomplete and is_possible(self._bytes[start : start + HEADER_SIZE]):
                return start
            start = self._bytes.find(MAGIC_BYTE, start + 1)
        return len(self._bytes)

    def _skip(self, count: int) -> None:
        self.skipped += count
        del self._bytes[:count]


def is_possible(header: bytearray) -> bool:
    """Return whether a header, perhaps a part of one, can begin a frame of the dialect."""
    if len(header) < HEADER_SIZE:
        return True
    wire = WIRE_OF_ID.get(int.from_bytes(header[7:10], "little"))
    return wire is not None and header[2] == 0 and 0 < header[1] <= wire.size
