"""The black box: frames go to the end of a file in whole batches; it never holds up who sent them.

A batch is one `write`, so a kill leaves whole records and at most one torn tail. While the disk is
full or hangs the frames wait in bounded memory and the newest are let go, counted, until there is
room. What was written since the last good synchronisation counts as lost when one fails: the kernel
may have dropped it, and reports success the next time.
"""

import fcntl
import os
import threading
from collections import deque
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Protocol

from ground.recording.tlog import record_bytes, whole
from runtime.units import NS_PER_US

HELD_BYTES: Final = 8 << 20
FRAME_COST: Final = 300
"""Bytes of memory that a waiting frame takes beside its own."""

MAX_KEY: Final = 250
"""Letters of a key, which is in the MCAP with each frame; all of ours are shorter."""

TOO_SLOW: Final = "the disk took too long"


class LogFormat(Protocol):
    """How frames are laid out in a file; what `batch` and `end` give is appended as it is.

    `time_us` is when a frame arrived, which never goes back; `told_us` when it was told.
    """

    def add(self, key: str, frame: bytes, time_us: int, told_us: int) -> None: ...
    def know(self, name: str, text: str) -> None: ...
    def batch(self) -> bytes: ...
    def end(self) -> bytes: ...


class TlogFormat:
    """A `.tlog`: one record after the other, no place for facts, nor for a second stamp."""

    def __init__(self) -> None:
        self._records: list[bytes] = []

    def add(self, key: str, frame: bytes, time_us: int, told_us: int) -> None:
        self._records.append(record_bytes(time_us, frame))

    def know(self, name: str, text: str) -> None:
        """Only frames have a place in it."""

    def batch(self) -> bytes:
        batch = b"".join(self._records)
        self._records.clear()
        return batch

    def end(self) -> bytes:
        return self.batch()


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
        with suppress(OSError):  # not every file system can
            fcntl.flock(self._fd, fcntl.LOCK_EX)  # shows that it is being written

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

    def __init__(
        self,
        sink: Sink,
        utc_offset_ns: int,
        held_bytes: int = HELD_BYTES,
        form: LogFormat | None = None,
        began_us: int = 0,
    ) -> None:
        """`utc_offset_ns` is what must be added to a frame's time of arrival to get UTC.

        What was told before `began_us` (UTC), and is fetched, arrives then.
        """
        self._sink = sink
        self._utc_offset_ns = utc_offset_ns
        self._held_bytes = held_bytes
        self._form: LogFormat = TlogFormat() if form is None else form
        self._arrived: deque[tuple[str, bytes, int]] = deque()
        self._arrived_bytes = 0
        self._arriving = threading.Lock()
        self._overflowed = 0  # changed under the lock
        self._dropped = 0  # changed by the thread that writes
        self._synced = self._unsynced = 0  # changed by the thread that synchronises
        self._waiting = bytearray()
        self._waiting_frames = 0
        self._newest_us = began_us
        self.written = 0
        self.rejected = 0
        self.trouble = ""
        self.why_dropped = ""

    @property
    def dropped(self) -> int:
        """Frames that are not in the file, or may not be on the disk."""
        return self._overflowed + self._dropped + self._unsynced

    def take(self, key: str, frame: bytes, told_ns: int) -> None:
        """Called by the bus: keeps a reference, no more, and no more than so many bytes."""
        with self._arriving:
            if self._arrived_bytes > self._held_bytes:
                self._overflowed += 1
                self.why_dropped = TOO_SLOW
                return
            self._arrived_bytes += len(frame) + len(key) + FRAME_COST
            self._arrived.append((key, frame, told_ns))

    def know(self, name: str, text: str) -> None:
        """A fact beside the frames, where the form has a place for it."""
        self._form.know(name, text)

    def flush(self) -> bool:
        """Write what has arrived; False, and `trouble`, when the file would not take it."""
        self._collect()
        self._waiting += self._form.batch()
        return self._append()

    def sync(self) -> None:
        """Ask the disk to have it too; a disk that cannot is named in `trouble`.

        What was written since the last good one is counted as dropped then, once and for all.
        """
        written = self.written
        try:
            self._sink.sync()
        except OSError as error:
            self.trouble = self.why_dropped = error.strerror or str(error)
            self._unsynced += written - self._synced
        self._synced = written

    def close(self) -> bool:
        """Write the rest and close; did everything get in?"""
        self._collect()
        self._waiting += self._form.end()
        complete = self._append()
        if not complete:
            self._dropped += self._waiting_frames
            self.why_dropped = self.trouble
        self.sync()
        self._sink.close()
        return complete and not self.dropped

    def _append(self) -> bool:
        if not self._waiting:
            return True
        try:
            self._sink.append(bytes(self._waiting))
        except OSError as error:
            self.trouble = error.strerror or str(error)
            return False
        self.written += self._waiting_frames
        self._waiting.clear()
        self._waiting_frames = 0
        self.trouble = ""
        return True

    def _collect(self) -> None:
        with self._arriving:
            arrived, self._arrived = self._arrived, deque()
            self._arrived_bytes = 0
        for key, frame, told_ns in arrived:
            if not whole(frame) or len(key) > MAX_KEY:
                self.rejected += 1  # written, it would put a reader out of step
            elif len(self._waiting) > self._held_bytes:
                self._dropped += 1
                self.why_dropped = self.trouble
            else:
                told_us = (told_ns + self._utc_offset_ns) // NS_PER_US
                self._newest_us = max(self._newest_us, told_us)
                self._form.add(key, frame, self._newest_us, told_us)
                self._waiting_frames += 1


def new_log(folder: Path, robot: str, started: datetime) -> LogFile:
    """A fresh file in the folder, which is made if need be; OSError when it cannot be."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"{started.astimezone(UTC):%Y%m%dT%H%M%SZ}-{robot}"
    for number in range(1000):
        with suppress(FileExistsError):
            return LogFile(folder / f"{stem}{f'.{number}' if number else ''}.tlog")
    raise FileExistsError("a thousand logs of this second exist already")


def beside(log: LogFile, suffix: str) -> LogFile:
    """Another file of the same run, of the same name but for its suffix."""
    return LogFile(log.path.with_suffix(suffix))
