"""Find MAVLink frames in a stream of bytes, without I/O."""

from collections.abc import Iterator

from protocol.wire.codec import HEADER_SIZE, MAGIC_BYTE, OUTSIDE, decode
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
        while True:
            start = self._bytes.find(MAGIC_BYTE)
            self._skip(len(self._bytes) if start < 0 else start)
            if len(self._bytes) < HEADER_SIZE:
                return
            size = OUTSIDE + self._bytes[1]
            if len(self._bytes) < size:
                return
            try:
                frame = decode(bytes(self._bytes[:size]))
            except RemoteError:
                self._skip(1)
                continue
            del self._bytes[:size]
            yield frame.message

    def _skip(self, count: int) -> None:
        self.skipped += count
        del self._bytes[:count]
