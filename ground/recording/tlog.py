"""Read a `.tlog`: records of a big-endian time in us (8 bytes) and one MAVLink frame.

A truncated file is read up to the cut; the reader reports the loss.
"""

from collections.abc import Iterator
from pathlib import Path
from struct import Struct
from typing import BinaryIO, Final, NamedTuple

from protocol.wire.codec import decode
from runtime.errors import RemoteError
from runtime.files import opened

STAMP: Final = Struct(">Q")
MAGIC: Final = 0xFD
HEADER_SIZE: Final = 10
CHECKSUM_SIZE: Final = 2
SIGNATURE_SIZE: Final = 13
SIGNED: Final = 0x01
LARGEST_RECORD: Final = STAMP.size + HEADER_SIZE + 255 + CHECKSUM_SIZE + SIGNATURE_SIZE
CHUNK: Final = 1 << 18
EPOCH_2000_US: Final = 946_684_800_000_000
EPOCH_2200_US: Final = 7_258_118_400_000_000


class Record(NamedTuple):
    """One frame and its time of arrival, microseconds since 1970 in UTC."""

    time_us: int
    frame: bytes


def record_bytes(time_us: int, frame: bytes) -> bytes:
    """Return the bytes of a record."""
    return STAMP.pack(time_us) + frame


def frame_size(head: bytes) -> int:
    """Return the size of a frame from its first three bytes or more; 0 for no frame."""
    if len(head) < 3 or head[0] != MAGIC:
        return 0
    return HEADER_SIZE + head[1] + CHECKSUM_SIZE + (SIGNATURE_SIZE if head[2] & SIGNED else 0)


def is_whole_frame(frame: bytes) -> bool:
    """Return whether the bytes are exactly one frame, by the frame's own size."""
    return len(frame) > 0 and frame_size(frame) == len(frame)


class TlogReader:
    """Reads a log once from front to back; `lost_bytes` belong to no whole record."""

    def __init__(self, source: BinaryIO) -> None:
        self._source = source
        self._buffer = bytearray()
        self._at = 0
        self._ended = False
        self._in_step = True
        self.records = 0
        self.lost_bytes = 0
        self.gaps = 0

    def __iter__(self) -> Iterator[Record]:
        while self._available(LARGEST_RECORD + STAMP.size + 3):
            size = self._record_size()
            if size:
                yield self._take(size)
            else:
                self._skip()

    def _available(self, size: int) -> bool:
        """Buffer `size` bytes or the rest of the file; return False at its end."""
        if len(self._buffer) - self._at < size and not self._ended:
            del self._buffer[: self._at]
            self._at = 0
            chunk = self._source.read(CHUNK)
            self._buffer += chunk
            self._ended = not chunk
            if not self._ended:
                return self._available(size)
        return self._at < len(self._buffer)

    def _record_size(self) -> int:
        """Return the size of the whole record at the present position, 0 when there is none."""
        size = self._claimed_size(self._at)
        end = self._at + size
        if not size or end > len(self._buffer):
            return 0
        if _decodes(bytes(self._buffer[self._at + STAMP.size : end])):
            return size
        # A frame of a newer dialect cannot be checked; accept it if another record follows.
        followed = end == len(self._buffer) or self._claimed_size(end)
        return size if self._in_step and followed else 0

    def _claimed_size(self, at: int) -> int:
        """Return the size that a record at a position claims; 0 when there is no record."""
        head = bytes(self._buffer[at : at + STAMP.size + 3])
        if len(head) < STAMP.size + 3:
            return 0
        (time_us,) = STAMP.unpack_from(head)
        size = frame_size(head[STAMP.size :])
        return STAMP.size + size if size and EPOCH_2000_US <= time_us < EPOCH_2200_US else 0

    def _take(self, size: int) -> Record:
        (time_us,) = STAMP.unpack_from(self._buffer, self._at)
        frame = bytes(self._buffer[self._at + STAMP.size : self._at + size])
        self._at += size
        self._in_step = True
        self.records += 1
        return Record(time_us, frame)

    def _skip(self) -> None:
        """Move to the next byte at which a record may begin."""
        self.gaps += self._in_step
        self._in_step = False
        magic = self._buffer.find(MAGIC, self._at + 1 + STAMP.size)
        nowhere = max(self._at + 1, len(self._buffer) - STAMP.size)
        place = nowhere if magic < 0 else magic - STAMP.size
        self.lost_bytes += place - self._at
        self._at = place

    def damage(self) -> str:
        """Return what was lost, in words; empty when nothing was lost."""
        if not self.lost_bytes:
            return ""
        places = "one place" if self.gaps == 1 else f"{self.gaps} places"
        return f"{self.lost_bytes} bytes in {places} belong to no whole record and were skipped"


def read(path: Path) -> Iterator[Record]:
    """Yield the whole records of a file."""
    with opened(path) as source:
        yield from TlogReader(source)


def _decodes(frame: bytes) -> bool:
    try:
        decode(frame)
    except RemoteError:
        return False
    return True
