"""The time stamps of signatures: units of 10 us since 2015, never used twice, also after a restart.

Stamps from before the start of the process are refused, so that nothing recorded before a restart
can be replayed. A file keeps the newest stamp: the clock may be set back, or the clock of a client
may be ahead.
"""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import Final

from runtime.files import make_folder, replace, text_in
from runtime.units import NS_PER_S

EPOCH_S: Final = 1_420_070_400
"""2015-01-01 00:00 UTC as Unix time."""
STAMP_NS: Final = 10_000
PER_S: Final = 100_000
MAX_BYTES: Final = 4096
SAVED_EVERY: Final = 10 * PER_S
"""Interval at which the file is written."""
MAX_STAMP: Final = (1 << 47) - 1
"""The year 2059: half of what the field can carry, so that later stamps fit too.

A file with a larger number is damaged.
"""
MAX_DIGITS: Final = len(str(MAX_STAMP))


class StampClock:
    """Issues stamps, and stores the newest one that was used; `floor` is the stamp of the start."""

    def __init__(
        self,
        unix_ns: Callable[[], int],
        path: Path | None = None,
        write: Callable[[Path, int], None] | None = None,
    ) -> None:
        self._unix_ns = unix_ns
        self._path = path
        self._write = write or write_stamp
        self._saved = _read(path)
        self.floor = self._newest = max(self._saved, self.now())

    @property
    def newest(self) -> int:
        """The present, as clients have to see it: the newest stamp, also if the clock is behind."""
        return max(self._newest, self.now())

    def now(self) -> int:
        """Return the stamp of the present time."""
        return max(0, self._unix_ns() - EPOCH_S * NS_PER_S) // STAMP_NS

    def next(self) -> int:
        """Return a stamp for a frame to send: the present time, and later than all before."""
        self._newest = max(self._newest + 1, self.now())
        if self._newest >= self._saved + SAVED_EVERY:
            self._save(self._newest)
        return self._newest

    def accept(self, stamp: int) -> None:
        """Store the stamp of a verified frame."""
        self._newest = max(self._newest, stamp)
        if self._newest >= self._saved + SAVED_EVERY:
            self._save(self._newest)
        elif stamp > self.now() and stamp > self._saved:
            self._save(stamp + SAVED_EVERY)

    def _save(self, stamp: int) -> None:
        self._saved = stamp
        if self._path is not None:
            self._write(self._path, stamp)


class BackgroundWriter:
    """Writes stamps in another thread, so that a slow disk delays no frame; may leave some out."""

    def __init__(self) -> None:
        self._thread: Thread | None = None

    def __call__(self, path: Path, stamp: int) -> None:
        """Begin to write a stamp unless the one before is still being written."""
        if self._thread is None or not self._thread.is_alive():
            self._thread = Thread(target=write_stamp, args=(path, stamp), daemon=True)
            self._thread.start()


def write_stamp(path: Path, stamp: int) -> None:
    """Replace the stamp in the file, if that is possible."""
    with suppress(OSError):
        make_folder(path.parent)
        replace(path, f"{stamp}\n")


def _read(path: Path | None) -> int:
    try:
        text = "" if path is None else text_in(path, MAX_BYTES).strip()
    except (OSError, ValueError):
        return 0
    is_number = text.isascii() and text.isdecimal() and len(text) <= MAX_DIGITS
    stamp = int(text) if is_number else 0
    return stamp if stamp <= MAX_STAMP else 0
