"""One run, written to two files at once: the `.tlog` that every MAVLink tool reads, and MCAP."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Self

from ground.recording.build_info import build
from ground.recording.log_writer import Recorder, beside, new_log
from ground.recording.mcap.writer import McapFormat

TLOG_EVERY = 1
MCAP_EVERY = 2
"""Rounds between two batches: a chunk of MCAP is better for being longer."""


@dataclass(frozen=True, slots=True)
class Track:
    """One of the files."""

    path: Path
    recorder: Recorder
    every: int


class SyncThread:
    """Has the disk keep what was written, in a thread of its own: a slow disk holds up no batch,
    and what was written survives the end of this process."""

    def __init__(self, recorders: Sequence[Recorder]) -> None:
        self._recorders = recorders
        self._due = threading.Event()
        self._ending = False
        self._thread: threading.Thread | None = None

    def ask(self) -> None:
        """As soon as it has done with the last time."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="sync", daemon=True)
            self._thread.start()
        self._due.set()

    def close(self) -> None:
        """No more, so that the files can be closed."""
        self._ending = True
        self._due.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while self._due.wait():
            self._due.clear()
            if self._ending:  # looked at last: what was set before it is not waited for again
                return
            for recorder in self._recorders:
                recorder.sync()


class DualLog:
    """Takes frames from any thread, writes them from one. Each file has its own trouble."""

    def __init__(self, tracks: tuple[Track, ...]) -> None:
        self.tracks = tracks
        self._taking = threading.Lock()
        self._closing = False
        self._syncing = SyncThread([track.recorder for track in tracks])

    @classmethod
    def new(cls, folder: Path, robot: str, started: datetime, utc_offset_ns: int) -> Self:
        """Two fresh files of one name; OSError when one of them cannot be made."""
        log = new_log(folder, robot, started)
        form = McapFormat(robot, build())
        mcap = beside(log, ".mcap")
        began_us = round(started.timestamp() * 1e6)
        as_tlog = Recorder(log, utc_offset_ns, began_us=began_us)
        as_mcap = Recorder(mcap, utc_offset_ns, form=form, began_us=began_us)
        return cls((Track(log.path, as_tlog, TLOG_EVERY), Track(mcap.path, as_mcap, MCAP_EVERY)))

    @property
    def path(self) -> Path:
        return self.tracks[0].path

    @property
    def trouble(self) -> str:
        """What ails the first file that ails; empty when none does."""
        return next((t.recorder.trouble for t in self.tracks if t.recorder.trouble), "")

    @property
    def dropped(self) -> int:
        """Frames that one of the files has not got."""
        return max(track.recorder.dropped for track in self.tracks)

    @property
    def why_dropped(self) -> str:
        return next((t.recorder.why_dropped for t in self.tracks if t.recorder.dropped), "")

    def take(self, key: str, frame: bytes, told_ns: int) -> None:
        """In all files or, once they are being closed, in none."""
        with self._taking:
            if not self._closing:
                for track in self.tracks:
                    track.recorder.take(key, frame, told_ns)

    def know(self, name: str, text: str) -> None:
        for track in self.tracks:
            track.recorder.know(name, text)

    def flush(self, round_number: int, sync_every: int) -> None:
        """Write what is due in this round, and have the disk keep it every so many rounds."""
        for track in self.tracks:
            if round_number % track.every == 0:
                track.recorder.flush()
        if round_number % sync_every == 0:
            self._syncing.ask()

    def close(self) -> bool:
        with self._taking:
            self._closing = True
        self._syncing.close()
        complete = [track.recorder.close() for track in self.tracks]
        return all(complete)
