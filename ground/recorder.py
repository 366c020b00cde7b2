"""The black box: frames go to the end of a file in whole batches; it never holds up who sent them.

A batch is one `write`, so a kill leaves whole records and at most one torn tail. When the disk is
full the frames wait in bounded memory and the newest are let go, counted, until there is room.
"""

import os
from collections import deque
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Protocol

from ground.tlog import record_bytes, whole

HELD_BYTES: Final = 8 << 20
NS_PER_US: Final = 1000


class Sink(Protocol):
    """Where batches go. `append` writes all of it or raises OSError and leaves nothing of it."""

    def append(self, batch: bytes) -> None: ...
    def sync(self) -> None: ...
    def close(self) -> None: ...


class LogFile:
    """A new file that only grows, and only by whole batches."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._size = 0
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)

    def append(self, batch: bytes) -> None:
        try:
            rest = memoryview(batch)
            while rest:
                rest = rest[os.write(self._fd, rest) :]
        except OSError:
            # What a full disk took of the batch would be a torn record in the middle of the log.
            os.ftruncate(self._fd, self._size)
            os.lseek(self._fd, self._size, os.SEEK_SET)
            raise
        self._size += len(batch)

    def sync(self) -> None:
        os.fdatasync(self._fd)

    def close(self) -> None:
        os.close(self._fd)


class Recorder:
    """Takes frames from any thread, writes them from one. Frames are stamped in UTC."""

    def __init__(self, sink: Sink, utc_offset_ns: int, held_bytes: int = HELD_BYTES) -> None:
        """`utc_offset_ns` is what must be added to a frame's time of arrival to get UTC."""
        self._sink = sink
        self._utc_offset_ns = utc_offset_ns
        self._held_bytes = held_bytes
        self._waiting: deque[bytes] = deque()
        self._arrived: deque[tuple[bytes, int]] = deque()
        self._waiting_bytes = 0
        self.written = 0
        self.dropped = 0
        self.rejected = 0
        self.trouble = ""

    def take(self, key: str, frame: bytes, arrived_ns: int) -> None:
        """Called by the bus: keeps a reference, no more."""
        self._arrived.append((frame, arrived_ns))

    def flush(self) -> bool:
        """Write what has arrived; False, and `trouble`, when the file would not take it."""
        self._collect()
        if not self._waiting:
            return True
        try:
            self._sink.append(b"".join(self._waiting))
        except OSError as error:
            self.trouble = error.strerror or str(error)
            return False
        self.written += len(self._waiting)
        self._waiting.clear()
        self._waiting_bytes = 0
        self.trouble = ""
        return True

    def sync(self) -> None:
        """Ask the disk to have it too; a disk that cannot is named in `trouble`."""
        try:
            self._sink.sync()
        except OSError as error:
            self.trouble = error.strerror or str(error)

    def close(self) -> bool:
        """Write the rest and close; did everything get in?"""
        complete = self.flush()
        if not complete:
            self.dropped += len(self._waiting)
        self._sink.close()
        return complete and not self.dropped

    def _collect(self) -> None:
        for _ in range(len(self._arrived)):
            frame, arrived_ns = self._arrived.popleft()
            if not whole(frame):
                self.rejected += 1  # written, it would put a reader out of step
            elif self._waiting_bytes > self._held_bytes:
                self.dropped += 1
            else:
                record = record_bytes((arrived_ns + self._utc_offset_ns) // NS_PER_US, frame)
                self._waiting.append(record)
                self._waiting_bytes += len(record)


def new_log(folder: Path, robot: str, started: datetime) -> LogFile:
    """A fresh file in the folder, which is made if need be; OSError when it cannot be."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"{started.astimezone(UTC):%Y%m%dT%H%M%SZ}-{robot}"
    return _first_free(lambda n: LogFile(folder / f"{stem}{f'-{n}' if n else ''}.tlog"))


def _first_free(make: Callable[[int], LogFile]) -> LogFile:
    for number in range(1000):
        try:
            return make(number)
        except FileExistsError:
            continue
    raise FileExistsError("a thousand logs of this second exist already")
