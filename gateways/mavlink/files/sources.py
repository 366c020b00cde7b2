"""Sources that clients read: bytes in memory, or a file with its size at the time of opening."""

import os
from pathlib import Path
from typing import Final, Protocol

LARGEST: Final = 0xFFFF_FFFF
"""Offsets and sizes have 32 bits."""


class Source(Protocol):
    """Data of a fixed size."""

    @property
    def size(self) -> int:
        """The size in bytes."""

    def read(self, offset: int, count: int) -> bytes:
        """Return at most `count` bytes; none beyond the end. OSError if it cannot be read."""

    def close(self) -> None:
        """Release it."""


class BytesSource:
    """Bytes in memory."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    @property
    def size(self) -> int:
        """The size in bytes."""
        return len(self._data)

    def read(self, offset: int, count: int) -> bytes:
        """Return at most `count` bytes."""
        return self._data[offset : offset + count]

    def close(self) -> None:
        """Keep nothing open."""


class FileSource:
    """A file, without bytes that are appended later. OSError if it cannot be opened."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        self.size = min(os.fstat(self._fd).st_size, LARGEST)

    def read(self, offset: int, count: int) -> bytes:
        """Return at most `count` bytes."""
        return os.pread(self._fd, max(0, min(count, self.size - offset)), offset)

    def close(self) -> None:
        """Close the file."""
        os.close(self._fd)
