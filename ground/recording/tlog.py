"""A .tlog file: eight bytes of big-endian microseconds, then one MAVLink frame, over and over.

A file that was cut off anywhere is read up to the cut, and the reader says how much was lost.
"""

from collections.abc import Iterator
from pathlib import Path
from struct import Struct
from typing import BinaryIO, Final, NamedTuple

from protocol.wire.codec import decode
from runtime.errors import RemoteError

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
    """One frame and when it arrived, microseconds since 1970 in UTC."""

    time_us: int
    frame: bytes


def record_bytes(time_us: int, frame: bytes) -> bytes:
    return STAMP.pack(time_us) + frame


def frame_size(head: bytes) -> int:
    """Size of the frame that begins with these (at least three) bytes; 0 when none does."""
    if len(head) < 3 or head[0] != MAGIC:
        return 0
    return HEADER_SIZE + head[1] + CHECKSUM_SIZE + (SIGNATURE_SIZE if head[2] & SIGNED else 0)


def whole(frame: bytes) -> bool:
    """Is this exactly one frame, by its own account of its size?"""
    return len(frame) > 0 and frame_size(frame) == len(frame)


class Reader:
    """Reads a log once, front to back; `lost_bytes` are those that belong to no whole record."""

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
        """Have `size` bytes ready, or what is left of the file; False at its end."""
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
        """Size of the whole record at the present place, 0 when there is none."""
        size = self._claimed_size(self._at)
        end = self._at + size
        if not size or end > len(self._buffer):
            return 0
        if _decodes(bytes(self._buffer[self._at + STAMP.size : end])):
            return size
        # A frame of a newer dialect cannot be checked; it is believed if its neighbour fits.
        followed = end == len(self._buffer) or self._claimed_size(end)
        return size if self._in_step and followed else 0

    def _claimed_size(self, at: int) -> int:
        """Size of the record that seems to begin there; 0 when nothing of the kind does."""
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
        """On to the next byte at which a record may begin."""
        self.gaps += self._in_step
        self._in_step = False
        magic = self._buffer.find(MAGIC, self._at + 1 + STAMP.size)
        nowhere = max(self._at + 1, len(self._buffer) - STAMP.size)
        place = nowhere if magic < 0 else magic - STAMP.size
        self.lost_bytes += place - self._at
        self._at = place

    def damage(self) -> str:
        """What was lost, in words; empty when nothing was."""
        if not self.lost_bytes:
            return ""
        places = "one place" if self.gaps == 1 else f"{self.gaps} places"
        return f"{self.lost_bytes} bytes in {places} belong to no whole record and were left out"


def read(path: Path) -> Iterator[Record]:
    """The whole records of a file."""
    with path.open("rb") as source:
        yield from Reader(source)


def _decodes(frame: bytes) -> bool:
    try:
        decode(frame)
    except RemoteError:
        return False
    return True
