"""Write one run to two files: a `.tlog`, which every MAVLink tool reads, and an MCAP file."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Self

from ground.recording.build_info import build
from ground.recording.log_writer import LogWriter, new_log, sibling
from ground.recording.mcap.writer import McapFormat

TLOG_EVERY = 1
MCAP_EVERY = 2
"""Number of rounds between two batches; longer MCAP chunks compress better."""


@dataclass(frozen=True, slots=True)
class Track:
    """One of the two files."""

    path: Path
    writer: LogWriter
    every: int


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

    `taken` is the number of accepted frames.
    """

    def __init__(self, tracks: tuple[Track, ...]) -> None:
        self.tracks = tracks
        self._lock = threading.Lock()
        self._closing = False
        self.taken = 0
        self._sync_thread = SyncThread([track.writer for track in tracks])

    @classmethod
    def new(cls, folder: Path, robot: str, started: datetime, utc_offset_ns: int) -> Self:
        """Create two files of the same name; OSError when one of them cannot be created."""
        log = new_log(folder, robot, started)
        form = McapFormat(robot, build())
        mcap = sibling(log, ".mcap")
        began_us = round(started.timestamp() * 1e6)
        as_tlog = LogWriter(log, utc_offset_ns, began_us=began_us)
        as_mcap = LogWriter(mcap, utc_offset_ns, form=form, began_us=began_us)
        return cls((Track(log.path, as_tlog, TLOG_EVERY), Track(mcap.path, as_mcap, MCAP_EVERY)))

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
        """Add a fact, such as the world, to the files that can hold it."""
        for track in self.tracks:
            track.writer.add_fact(name, text)

    def flush(self, round_number: int, sync_every: int) -> None:
        """Write the files that are due; flush them to the disk every `sync_every` rounds."""
        for track in self.tracks:
            if round_number % track.every == 0:
                track.writer.flush()
        if round_number % sync_every == 0:
            self._sync_thread.request()

    def close(self) -> bool:
        """Write the rest and close the files; return whether every frame is in them."""
        with self._lock:
            self._closing = True
        self._sync_thread.close()
        complete = [track.writer.close() for track in self.tracks]
        return all(complete)
