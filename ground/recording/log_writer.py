"""Write a run to a `.tlog` and an MCAP file, without delaying the senders.

Every MAVLink tool reads a `.tlog`. Both are continued in a next part when they are large or old, so
that retention can delete the beginning of a long run.

A batch is one `write`, so a kill leaves whole records and at most one partial record. While the
disk is full or hangs, frames wait in bounded memory; beyond the limit the newest are dropped and
counted. When a flush to the disk fails, all data since the last good flush count as lost: the
kernel may have dropped them, and the next flush reports success.
"""

import fcntl
import os
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic
from typing import Final, Protocol, Self

from ground.recording.log_reader import (
    PART_BYTES,
    PART_S,
    is_whole_frame,
    part_of,
    record_bytes,
)
from ground.recording.mcap_file import McapFormat
from ground.recording.metadata import build
from runtime.units import NS_PER_US

MAX_WAITING_BYTES: Final = 8 << 20
FRAME_COST: Final = 300
"""Memory in bytes that a waiting frame takes besides its content."""

MAX_KEY: Final = 250
"""Longest key in characters; MCAP stores the key with each frame."""

TOO_SLOW: Final = "the disk took too long"
FLUSH_NS: Final = 250_000_000
SYNC_EVERY: Final = 4
"""Recorders write what waits at this interval, and synchronise the file in every fourth round."""


class LogFormat(Protocol):
    """Layout of frames in a file; the results of `batch` and `end` are appended unchanged.

    `time_us` is the time of arrival, which never decreases; `published_us` is the time of
    publication.
    """

    def add(self, key: str, frame: bytes, time_us: int, published_us: int) -> None:
        """Add a whole frame."""

    def add_fact(self, name: str, text: str) -> None:
        """Add a fact."""

    def batch(self) -> bytes:
        """Return everything since the last batch."""
        ...

    def end(self) -> bytes:
        """Return the rest of the file."""
        ...


class TlogFormat:
    """A `.tlog`: one record after the other, without facts and without times of publication."""

    def __init__(self) -> None:
        self._records: list[bytes] = []

    def add(self, key: str, frame: bytes, time_us: int, published_us: int) -> None:
        """Add a frame."""
        self._records.append(record_bytes(time_us, frame))

    def add_fact(self, name: str, text: str) -> None:
        """Ignore a fact: a `.tlog` holds frames only."""

    def batch(self) -> bytes:
        """Return the records since the last batch."""
        batch = b"".join(self._records)
        self._records.clear()
        return batch

    def end(self) -> bytes:
        """Return the rest."""
        return self.batch()


class Sink(Protocol):
    """Target of batches. `append` writes all of a batch, or raises OSError and writes nothing."""

    def append(self, batch: bytes) -> None:
        """Append a whole batch or nothing."""

    def sync(self) -> None:
        """Flush the data to the disk."""

    def close(self) -> None:
        """Close the target."""


class LogFile:
    """A new file that grows by whole batches only."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = 0
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        with suppress(OSError):  # not every file system can
            fcntl.flock(self._fd, fcntl.LOCK_EX)  # shows that it is being written

    def append(self, batch: bytes) -> None:
        """Append a whole batch, or raise OSError and leave the file unchanged."""
        try:
            self.put(batch, self.size)
        except OSError:
            # A full disk may have taken a part of the batch: a partial record in the middle of the
            # log.
            os.ftruncate(self._fd, self.size)
            raise
        self.size += len(batch)

    def put(self, data: bytes, place: int) -> None:
        """Write at a place in the file; raise OSError, when a part may be written."""
        rest = memoryview(data)
        while rest:
            written = os.pwrite(self._fd, rest, place)
            rest, place = rest[written:], place + written

    def sync(self) -> None:
        """Flush the data to the disk."""
        os.fdatasync(self._fd)

    def close(self) -> None:
        """Close the file."""
        os.close(self._fd)


def is_frame_with_key(key: str, frame: bytes) -> bool:
    """Return whether a frame is whole, and its key not too long."""
    return is_whole_frame(frame) and len(key) <= MAX_KEY


class LogWriter:
    """Accepts frames from any thread and writes them from one; stamps are in UTC.

    `sync` may be called from a third thread.
    """

    def __init__(
        self,
        sink: Sink,
        utc_offset_ns: int,
        max_waiting_bytes: int = MAX_WAITING_BYTES,
        form: LogFormat | None = None,
        began_us: int = 0,
        accepts: Callable[[str, bytes], bool] = is_frame_with_key,
    ) -> None:
        """Create a writer; `utc_offset_ns` is added to a time of arrival to get UTC.

        A frame is left out unless `accepts` returns True: it would break the framing of the file.

        A cached sample published before `began_us` (UTC) gets `began_us` as its time of arrival.
        """
        self._sinks = deque([sink])
        """The last one is written; those before wait until they are on the disk and closed."""
        self._utc_offset_ns = utc_offset_ns
        self._held_bytes = max_waiting_bytes
        self._accepts = accepts
        self._form: LogFormat = TlogFormat() if form is None else form
        self._arrived: deque[tuple[str, bytes, int]] = deque()
        self._arrived_bytes = 0
        self._lock = threading.Lock()
        self._overflowed = 0  # changed under the lock
        self._dropped = 0  # changed by the thread that writes
        self._synced = self._unsynced = 0  # changed by the thread that synchronises
        self._waiting = bytearray()
        self._waiting_frames = 0
        self._newest_us = began_us
        self.written = 0
        self.size = 0
        """Number of bytes in the file that is being written."""
        self.rejected = 0
        self.error = ""
        self.drop_reason = ""

    @property
    def dropped(self) -> int:
        """Number of frames that are not in the file or may not be on the disk."""
        return self._overflowed + self._dropped + self._unsynced

    def take(self, key: str, frame: bytes, published_ns: int) -> None:
        """Store a frame by reference, up to a limit in bytes; called by the bus."""
        with self._lock:
            if self._arrived_bytes > self._held_bytes:
                self._overflowed += 1
                self.drop_reason = TOO_SLOW
                return
            self._arrived_bytes += len(frame) + len(key) + FRAME_COST
            self._arrived.append((key, frame, published_ns))

    def add_fact(self, name: str, text: str) -> None:
        """Add a fact, if the format can hold it."""
        self._form.add_fact(name, text)

    def flush(self) -> bool:
        """Write what has arrived; return False and set `error` when the file rejects it."""
        self._collect()
        self._waiting += self._form.batch()
        return self._append()

    @property
    def newest_us(self) -> int:
        """Time of arrival of the newest frame that was written."""
        return self._newest_us

    def begin_part(self, sink: Sink, form: LogFormat) -> None:
        """Write into another file from now on; call it after a `flush` that has written all.

        The end of the file before has the index only; without it the file is read as a whole.
        """
        with suppress(OSError):
            self._sinks[-1].append(self._form.end())
        self._form = form
        self._sinks.append(sink)
        self.size = 0

    def sync(self) -> None:
        """Flush the file to the disk; a failure is stored in `error`.

        Frames written since the last good flush then count as dropped, permanently.
        """
        written, failed = self.written, None
        for place in range(len(self._sinks), 0, -1):
            sink = self._sinks[0]
            try:
                sink.sync()
            except OSError as error:
                failed = error
            if place > 1:
                sink.close()
                self._sinks.popleft()
        if failed is not None:
            self.error = self.drop_reason = failed.strerror or str(failed)
            self._unsynced += written - self._synced
        self._synced = written

    def close(self) -> bool:
        """Write the rest and close; return whether every frame is in the file."""
        self._collect()
        self._waiting += self._form.end()
        complete = self._append()
        if not complete:
            self._dropped += self._waiting_frames
            self.drop_reason = self.error
        self.sync()
        self._sinks[0].close()
        return complete and not self.dropped

    def _append(self) -> bool:
        if not self._waiting:
            return True
        try:
            self._sinks[-1].append(bytes(self._waiting))
        except OSError as error:
            self.error = error.strerror or str(error)
            return False
        self.written += self._waiting_frames
        self.size += len(self._waiting)
        self._waiting.clear()
        self._waiting_frames = 0
        self.error = ""
        return True

    def _collect(self) -> None:
        with self._lock:
            arrived, self._arrived = self._arrived, deque()
            self._arrived_bytes = 0
        for key, frame, published_ns in arrived:
            if not self._accepts(key, frame):
                self.rejected += 1
            elif len(self._waiting) > self._held_bytes:
                self._dropped += 1
                self.drop_reason = self.error
            else:
                published_us = (published_ns + self._utc_offset_ns) // NS_PER_US
                self._newest_us = max(self._newest_us, published_us)
                self._form.add(key, frame, self._newest_us, published_us)
                self._waiting_frames += 1


def new_log(folder: Path, robot: str, started: datetime) -> LogFile:
    """Create a file in the folder, and the folder if needed; OSError on failure."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"{started.astimezone(UTC):%Y%m%dT%H%M%SZ}-{robot}"
    for number in range(1000):
        with suppress(FileExistsError):
            return LogFile(folder / f"{stem}{f'.{number}' if number else ''}.tlog")
    raise FileExistsError("a thousand logs of this second exist already")


TLOG_EVERY = 1
MCAP_EVERY = 2
"""Number of rounds between two batches; longer MCAP chunks compress better."""


@dataclass(frozen=True, slots=True)
class Track:
    """One kind of file of a run: the first one, and how a part with a number begins at a time."""

    path: Path
    writer: LogWriter
    every: int
    begin: Callable[[int, int], tuple[LogFile, LogFormat]]


class SyncThread:
    """Flush files to the disk in a separate thread, so that a slow disk delays no batch.

    Data written before the end of this process are therefore kept.
    """

    def __init__(self, recorders: Sequence[LogWriter]) -> None:
        self._recorders = recorders
        self._due = threading.Event()
        self._ending = False
        self._thread: threading.Thread | None = None

    def request(self) -> None:
        """Request a flush; it starts when the previous one has ended."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="sync", daemon=True)
            self._thread.start()
        self._due.set()

    def close(self) -> None:
        """End the thread, so that the files can be closed."""
        self._ending = True
        self._due.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while self._due.wait():
            self._due.clear()
            if self._ending:  # checked last: close() may have set the event before clear()
                return
            for recorder in self._recorders:
                recorder.sync()


class DualLog:
    """Accept frames from any thread and write them from one; each file has its own errors.

    `taken` is the number of accepted frames, `parts` that of the pairs of files so far. A part ends
    when both files together have `part_bytes`, or after `part_s`.
    """

    def __init__(
        self,
        tracks: tuple[Track, ...],
        *,
        part_bytes: int = PART_BYTES,
        part_s: float = PART_S,
        now_s: Callable[[], float] = monotonic,
    ) -> None:
        self.tracks = tracks
        self._lock = threading.Lock()
        self._closing = False
        self.taken = 0
        self.parts = 1
        self._part_bytes, self._part_s, self._now_s = part_bytes, part_s, now_s
        self._began_s = now_s()
        self._facts: dict[str, str] = {}
        self._sync_thread = SyncThread([track.writer for track in tracks])

    @classmethod
    def new(
        cls,
        folder: Path,
        robot: str,
        started: datetime,
        utc_offset_ns: int,
        *,
        part_bytes: int = PART_BYTES,
        part_s: float = PART_S,
        now_s: Callable[[], float] = monotonic,
    ) -> Self:
        """Create two files of the same name; OSError when one of them cannot be created."""
        log = new_log(folder, robot, started)
        facts = build()
        mcap = LogFile(log.path.with_suffix(".mcap"))
        began_us = round(started.timestamp() * 1e6)

        def mcap_part(number: int, begins_us: int) -> tuple[LogFile, LogFormat]:
            return LogFile(part_of(mcap.path, number)), McapFormat(robot, facts, begins_us)

        def tlog_part(number: int, _begins_us: int) -> tuple[LogFile, LogFormat]:
            return LogFile(part_of(log.path, number)), TlogFormat()

        as_tlog = LogWriter(log, utc_offset_ns, began_us=began_us)
        form = McapFormat(robot, facts, began_us)
        as_mcap = LogWriter(mcap, utc_offset_ns, form=form, began_us=began_us)
        tracks = (
            Track(log.path, as_tlog, TLOG_EVERY, tlog_part),
            Track(mcap.path, as_mcap, MCAP_EVERY, mcap_part),
        )
        return cls(tracks, part_bytes=part_bytes, part_s=part_s, now_s=now_s)

    @property
    def path(self) -> Path:
        """Path of the `.tlog`."""
        return self.tracks[0].path

    @property
    def error(self) -> str:
        """First error of a file; empty when there is none."""
        return next((t.writer.error for t in self.tracks if t.writer.error), "")

    @property
    def dropped(self) -> int:
        """Number of frames missing in the worse of the files."""
        return max(track.writer.dropped for track in self.tracks)

    @property
    def drop_reason(self) -> str:
        """Reason for the missing frames; empty when none is missing."""
        return next((t.writer.drop_reason for t in self.tracks if t.writer.dropped), "")

    def take(self, key: str, frame: bytes, published_ns: int) -> None:
        """Add a frame to all files; ignore it once the files are being closed."""
        with self._lock:
            if not self._closing:
                self.taken += 1
                for track in self.tracks:
                    track.writer.take(key, frame, published_ns)

    def add_fact(self, name: str, text: str) -> None:
        """Add a fact, such as the world, to the files that can hold it, and to each part."""
        self._facts[name] = text
        for track in self.tracks:
            track.writer.add_fact(name, text)

    def flush(self, round_number: int, sync_every: int) -> None:
        """Write the files that are due; flush them to the disk every `sync_every` rounds."""
        for track in self.tracks:
            if round_number % track.every == 0:
                track.writer.flush()
        size = sum(track.writer.size for track in self.tracks)
        if size >= self._part_bytes or self._now_s() - self._began_s >= self._part_s:
            self._begin_part()
        if round_number % sync_every == 0:
            self._sync_thread.request()

    def _begin_part(self) -> None:
        """Continue in new files; while that fails, as on a full disk, in those there are."""
        if not all(track.writer.flush() for track in self.tracks):
            return
        begun: list[tuple[LogFile, LogFormat]] = []
        try:
            for track in self.tracks:
                begun.append(track.begin(self.parts + 1, track.writer.newest_us))  # noqa: PERF401
        except OSError:
            for file, _ in begun:
                file.close()
                file.path.unlink(missing_ok=True)
            return
        for track, part in zip(self.tracks, begun, strict=True):
            track.writer.begin_part(*part)
        for name, text in self._facts.items():
            self.add_fact(name, text)
        self.parts += 1
        self._began_s = self._now_s()
        self._sync_thread.request()

    def close(self) -> bool:
        """Write the rest and close the files; return whether every frame is in them."""
        with self._lock:
            self._closing = True
        self._sync_thread.close()
        complete = [track.writer.close() for track in self.tracks]
        return all(complete)
