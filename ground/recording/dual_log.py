"""Write one run to two files: a `.tlog`, which every MAVLink tool reads, and an MCAP file.

Both are continued in a next part when they are large or old, so that retention can delete the
beginning of a long run.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from time import monotonic
from typing import Self

from ground.recording.build_info import build
from ground.recording.log_writer import LogFile, LogFormat, LogWriter, TlogFormat, new_log, sibling
from ground.recording.mcap.writer import McapFormat
from ground.recording.parts import PART_BYTES, PART_S, part_of

TLOG_EVERY = 1
MCAP_EVERY = 2
"""Number of rounds between two batches; longer MCAP chunks compress better."""


@dataclass(frozen=True, slots=True)
class Track:
    """One kind of file of a run: the first one, and the layout of one that begins at a time."""

    path: Path
    writer: LogWriter
    every: int
    form_at: Callable[[int], LogFormat]


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
        mcap = sibling(log, ".mcap")
        began_us = round(started.timestamp() * 1e6)

        def mcap_at(begins_us: int) -> LogFormat:
            return McapFormat(robot, facts, begins_us)

        def tlog_at(_begins_us: int) -> LogFormat:
            return TlogFormat()

        as_tlog = LogWriter(log, utc_offset_ns, began_us=began_us)
        form = mcap_at(began_us)
        as_mcap = LogWriter(mcap, utc_offset_ns, form=form, began_us=began_us)
        tracks = (
            Track(log.path, as_tlog, TLOG_EVERY, tlog_at),
            Track(mcap.path, as_mcap, MCAP_EVERY, mcap_at),
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
        files: list[LogFile] = []
        try:
            for track in self.tracks:
                files.append(LogFile(part_of(track.path, self.parts + 1)))  # noqa: PERF401
        except OSError:
            for file in files:
                file.close()
                file.path.unlink(missing_ok=True)
            return
        for track, file in zip(self.tracks, files, strict=True):
            track.writer.begin_part(file, track.form_at(track.writer.newest_us))
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
