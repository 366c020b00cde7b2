"""How much of older recordings is kept: the oldest go first, and never one that is being written.

Whoever writes one holds a lock on its files, so that is known of any recorder on this machine.
"""

import fcntl
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from ground.recording.log_reader import NAMED
from runtime.errors import UserError

SUFFIXES: Final = (".tlog", ".mcap")
UNITS: Final = {"MB": 10**6, "GB": 10**9}
SIZE: Final = re.compile(r"(?P<number>\d+(\.\d+)?) ?(?P<unit>[MG]B)\Z", re.IGNORECASE)
LOW_BYTES: Final = 10**9
BYTES_PER_HOUR: Final = 160 * 10**6
"""Of one robot that drives in wall time, both files."""


class Run(NamedTuple):
    """The files of one recording."""

    files: tuple[Path, ...]
    size: int


def size_in(text: str) -> int:
    """Bytes of a text such as 2GB or 500MB; UserError when it is none."""
    found = SIZE.match(text.strip())
    if found is None or not float(found["number"]):
        raise UserError(f"--keep {text!r} is no size: write it as 2GB or 500MB")
    return round(float(found["number"]) * UNITS[found["unit"].upper()])


def in_units(size: int) -> str:
    """For a person."""
    unit = "GB" if size >= UNITS["GB"] else "MB"
    return f"{size / UNITS[unit]:.3g} {unit}"


class Retention:
    """The recordings in one folder; `keep_bytes` None: all of them."""

    def __init__(self, folder: Path, keep_bytes: int | None) -> None:
        self._folder = folder
        self._keep_bytes = keep_bytes
        self._told_full = False

    def warning(self) -> str:
        """That there is little room for what begins now; empty when there is enough."""
        with suppress(OSError):
            free = shutil.disk_usage(self._folder).free
            if free < LOW_BYTES:
                hours = free / BYTES_PER_HOUR
                where = f"only {in_units(free)} free in {self._folder}"
                return f"{where}: enough for about {hours:.1f} h of one robot"
        return ""

    def tidy(self) -> str:
        """Delete what is too much; what was done, or that it does not suffice. Often empty."""
        if self._keep_bytes is None:
            return ""
        runs = list(self._runs())
        over = sum(run.size for run in runs) - self._keep_bytes
        gone = freed = 0
        for run in runs:
            if over - freed <= 0:
                break
            if deleted(run):
                gone += 1
                freed += run.size
        bound = f"{in_units(self._keep_bytes)} (--keep)"
        if gone:
            what = "the oldest recording" if gone == 1 else f"the {gone} oldest recordings"
            return f"deleted {what} in {self._folder}, {in_units(freed)}, to keep within {bound}"
        if over > 0 and not self._told_full:
            self._told_full = True
            return f"what is being recorded in {self._folder} alone exceeds {bound}; it is kept"
        return ""

    def _runs(self) -> Iterator[Run]:
        """The oldest first, as their names tell; files that are not named like ours are not."""
        found: dict[str, list[Path]] = {}
        for path in self._folder.iterdir():
            if path.suffix in SUFFIXES and NAMED.match(path.stem):
                found.setdefault(path.stem, []).append(path)
        for stem in sorted(found):
            yield Run(tuple(found[stem]), sum(map(size_of, found[stem])))


def size_of(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def deleted(run: Run) -> bool:
    """False when one of its files is being written, or cannot be deleted."""
    if any(map(being_written, run.files)):
        return False
    try:
        for path in run.files:
            path.unlink(missing_ok=True)
    except OSError:
        return False
    return True


def being_written(path: Path) -> bool:
    """Also where that cannot be found out: then nothing is deleted."""
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return True
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(fd)
    return False
