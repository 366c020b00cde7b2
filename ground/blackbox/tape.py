"""One run, written to two files at once: the `.tlog` that every MAVLink tool reads, and MCAP."""

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Self

from ground.blackbox.build import build
from ground.blackbox.mcap_form import McapForm
from ground.recorder import Recorder, beside, new_log

TLOG_EVERY = 1
MCAP_EVERY = 2
"""Rounds between two batches: a chunk of MCAP is better for being longer."""


@dataclass(frozen=True, slots=True)
class Track:
    """One of the files."""

    path: Path
    recorder: Recorder
    every: int


class Tape:
    """Takes frames from any thread, writes them from one. Each file has its own trouble."""

    def __init__(self, tracks: tuple[Track, ...]) -> None:
        self.tracks = tracks

    @classmethod
    def new(cls, folder: Path, robot: str, started: datetime, utc_offset_ns: int) -> Self:
        """Two fresh files of one name; OSError when one of them cannot be made."""
        log = new_log(folder, robot, started)
        form = McapForm(robot, build())
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

    def take(self, key: str, frame: bytes, told_ns: int) -> None:
        for track in self.tracks:
            track.recorder.take(key, frame, told_ns)

    def know(self, name: str, text: str) -> None:
        for track in self.tracks:
            track.recorder.know(name, text)

    def flush(self, round_number: int, sync_every: int) -> None:
        """Write what is due in this round, and have the disk keep it every so many rounds."""
        for track in self.tracks:
            if round_number % track.every or not track.recorder.flush():
                continue
            if round_number % sync_every == 0:
                track.recorder.sync()

    def close(self) -> bool:
        complete = [track.recorder.close() for track in self.tracks]
        return all(complete)
