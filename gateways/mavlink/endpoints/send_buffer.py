"""Frames that wait for a slow line: a bounded number, telemetry is dropped first."""

from collections.abc import Callable
from typing import Final

MAX_BYTES: Final = 65_536
STREAM_BYTES: Final = 2_048
"""With this much waiting, a frame of telemetry is dropped, because a newer one follows."""


class SendBuffer:
    """Sends by `write`, which returns how many bytes it took and never blocks."""

    def __init__(self, write: Callable[[bytes], int], stream_bytes: int = STREAM_BYTES) -> None:
        self.dropped = 0
        self._write = write
        self._stream_bytes = stream_bytes
        self._waiting = bytearray()

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, data: bytes, *, is_stream: bool) -> None:
        """Send a frame, now or later, or drop it; OSError if the line is lost."""
        limit = self._stream_bytes if is_stream else MAX_BYTES
        if self._waiting and len(self._waiting) + len(data) > limit:
            self.dropped += 1
            return
        self._waiting += data
        self.flush()

    def flush(self) -> None:
        """Send the waiting frames, as many as the line accepts; OSError if the line is lost."""
        if not self._waiting:
            return
        try:
            taken = self._write(bytes(self._waiting))
        except BlockingIOError:
            return
        del self._waiting[:taken]
