"""Delete the oldest recordings beyond a limit, but never one that is being written.

A recorder holds a lock on its files, which identifies those of all recorders on this machine.
"""

import re
import shutil
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from ground.recording.log_reader import NAMED, SUFFIXES, is_being_written
from runtime.errors import UserError

UNITS: Final = {"MB": 10**6, "GB": 10**9}
SIZE: Final = re.compile(r"(?P<number>\d+(\.\d+)?) ?(?P<unit>[MG]B)\Z", re.IGNORECASE)
LOW_BYTES: Final = 10**9
BYTES_PER_HOUR: Final = 160 * 10**6
"""Rate of both files for one robot that drives in wall time."""


class RecordingFiles(NamedTuple):
    """The files of one recording."""

    files: tuple[Path, ...]
    size: int


def size_in(text: str) -> int:
    """Return the bytes of a text such as 2GB or 500MB; UserError when it is malformed."""
    found = SIZE.match(text.strip())
    if found is None or not float(found["number"]):
        raise UserError(f"--keep {text!r} is not a size: write it as 2GB or 500MB")
    return round(float(found["number"]) * UNITS[found["unit"].upper()])


def size_text(size: int) -> str:
    """Return a size with its unit, for display."""
    unit = "GB" if size >= UNITS["GB"] else "MB"
    return f"{size / UNITS[unit]:.3g} {unit}"


class Retention:
    """The recordings in one folder; `keep_bytes` None keeps all of them."""

    def __init__(self, folder: Path, keep_bytes: int | None) -> None:
        self._folder = folder
        self._keep_bytes = keep_bytes
        self._reported_full = False

    def warning(self) -> str:
        """Return a warning when the disk has little room; empty when there is enough."""
        with suppress(OSError):
            free = shutil.disk_usage(self._folder).free
            if free < LOW_BYTES:
                hours = free / BYTES_PER_HOUR
                where = f"only {size_text(free)} free in {self._folder}"
                return f"{where}: enough for about {hours:.1f} h of one robot"
        return ""

    def delete_oldest(self) -> str:
        """Delete the oldest recordings beyond the limit; return what was done, often nothing."""
        if self._keep_bytes is None:
            return ""
        recordings = list(self._recordings())
        excess = sum(recording.size for recording in recordings) - self._keep_bytes
        count = freed = 0
        for recording in recordings:
            if excess - freed <= 0:
                break
            if delete(recording):
                count += 1
                freed += recording.size
        limit = f"{size_text(self._keep_bytes)} (--keep)"
        if count:
            what = "the oldest recording" if count == 1 else f"the {count} oldest recordings"
            return f"deleted {what} in {self._folder}, {size_text(freed)}, to keep within {limit}"
        if excess > 0 and not self._reported_full:
            self._reported_full = True
            return f"what is being recorded in {self._folder} alone exceeds {limit}; it is kept"
        return ""

    def _recordings(self) -> Iterator[RecordingFiles]:
        """Yield recordings from the oldest, by name; files with other names are ignored."""
        found: dict[str, list[Path]] = {}
        for path in self._folder.iterdir():
            if path.suffix in SUFFIXES and NAMED.match(path.stem):
                found.setdefault(path.stem, []).append(path)
        for stem in sorted(found):
            yield RecordingFiles(tuple(found[stem]), sum(map(size_of, found[stem])))


def size_of(path: Path) -> int:
    """Return the size of a file in bytes, 0 when it cannot be read."""
    try:
        return path.stat().st_size
    except OSError:
        return 0


def delete(recording: RecordingFiles) -> bool:
    """Delete a recording; return False when it is being written or cannot be deleted."""
    try:
        if any(map(is_being_written, recording.files)):
            return False
        for path in recording.files:
            path.unlink(missing_ok=True)
    except OSError:
        return False
    return True
