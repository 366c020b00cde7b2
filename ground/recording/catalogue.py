"""Find recordings, the newest first, and delete the oldest ones beyond a limit.

A file that is being written is never deleted: a recorder holds a lock on its files, which
identifies those of all recorders on this machine. Of a run that is being recorded, the oldest parts
are deleted.
"""

import re
import shutil
from collections.abc import Iterable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

from ground.recording.log_reader import (
    NAMED,
    PART_BYTES,
    SUFFIXES,
    files_of,
    is_being_written,
    is_running,
    number_of,
    part_of,
    parts_of,
    run_of,
)
from ground.user.folders import recordings_folder
from protocol.ros_bag import is_bag
from runtime.errors import UserError

BACK: Final = re.compile(r"-(?P<number>[1-9]\d{0,3})\Z")
STAMP: Final = "%Y%m%dT%H%M%SZ"
STAMP_CHARS: Final = 16
UNFINISHED: Final = "is still being recorded"
FILE_HELP: Final = (
    "a .tlog, an .mcap or a bag of ROS 2, or a folder: its newest one (default the newest finished"
    " one of `sidestep rec list`; -2 is the one before)"
)


def recordings_in(folder: Path, *, below: bool = False) -> list[Path]:
    """Return each run once, by the oldest part that is left, its .mcap if there is one.

    The newest is the first.

    `below`: also those one level below the folder. An unreadable folder has none.
    """
    found: dict[Path, Path] = {}
    try:
        for pattern in ("*", "*/*") if below else ("*",):
            paths = [path for path in folder.glob(pattern) if path.suffix in SUFFIXES]
            for path in sorted(paths, key=lambda path: (-number_of(path), path.suffix == ".mcap")):
                if path.is_file():
                    found[run_of(path)] = path
        return newest_first(found.values())
    except OSError:
        return []


def newest_first(paths: Iterable[Path]) -> list[Path]:
    """Return the recordings in order, the newest first; OSError if one has gone."""
    return sorted(paths, key=lambda path: (began(path), path.stem), reverse=True)


def began(path: Path) -> datetime:
    """Return when a recording began: by its name, else by the time of its file, in UTC."""
    if NAMED.match(path.stem):
        try:
            return datetime.strptime(path.stem[:STAMP_CHARS], STAMP).replace(tzinfo=UTC)
        except ValueError:
            pass
    return datetime.fromtimestamp(path.stat().st_mtime, UTC)


def recording_named(text: str | None) -> Path:
    """Return the recording for an argument FILE.

    None is the newest one of the user, `-2` the one before, and a folder its newest one. A
    recording that is still being written is chosen only by its name. Raises UserError if there is
    none.
    """
    back = BACK.match(text or "-1")
    if text is not None and (back is None or Path(text).exists()):
        path = Path(text)
        return newest(path, 1) if path.is_dir() and not is_bag(path) else path
    assert back is not None, "the default matches"
    return newest(recordings_folder(), int(back["number"]))


def newest(folder: Path, number: int) -> Path:
    """Return the newest finished recording of a folder, or with 2 the one before."""
    found = recordings_in(folder)
    if not found:
        raise UserError(f"{folder}: there is no recording; `sidestep up` makes one, or name a FILE")
    finished = [path for path in found if not is_running(path)]
    if not finished:
        raise UserError(f"{found[0]} {UNFINISHED}, and there is no other: end the run, or name it")
    if number > len(finished):
        raise UserError(f"-{number}: there are only {len(finished)} recordings in {folder}")
    return finished[number - 1]


def remark_on(path: Path, named: str | None) -> str:
    """Return the text of a verb about its recording: its path, and whether it is unfinished."""
    if is_running(path):
        return f"{path} {UNFINISHED}: this is the part that is already written"
    return "" if str(path) == named else str(path)


UNITS: Final = {"MB": 10**6, "GB": 10**9}
SIZE: Final = re.compile(r"(?P<number>\d+(\.\d+)?) ?(?P<unit>[MG]B)\Z", re.IGNORECASE)
LOW_BYTES: Final = 10**9
BYTES_PER_HOUR: Final = 160 * 10**6
"""Rate of both files for one robot that drives in wall time."""


PARTS: Final = 8
"""Parts of one run within the limit: so much of the limit is not used."""


class PartFiles(NamedTuple):
    """The files of one part of a recording; `ended_ns` is when the newest was written."""

    ended_ns: int
    files: tuple[Path, ...]
    size: int


def part_bytes(keep_bytes: int | None) -> int:
    """Return the size at which a part ends, for a limit."""
    return PART_BYTES if keep_bytes is None else max(1, min(PART_BYTES, keep_bytes // PARTS))


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
    """The recordings in one folder; `keep_bytes` None keeps all of them.

    `reserve_bytes` are kept free for a part that is about to be written.
    """

    def __init__(self, folder: Path, keep_bytes: int | None, reserve_bytes: int = 0) -> None:
        self._folder = folder
        self._keep_bytes = keep_bytes
        self._reserve_bytes = reserve_bytes
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
        parts = list(self._parts())
        excess = sum(part.size for part in parts) + self._reserve_bytes - self._keep_bytes
        runs, freed = set[Path](), 0
        for part in parts:
            if excess - freed <= 0:
                break
            if delete(part):
                runs.add(part_of(part.files[0], 1).with_suffix(SUFFIXES[0]))
                freed += part.size
        limit = f"{size_text(self._keep_bytes)} (--keep)"
        if runs:
            count = len(runs)
            what = "the oldest recording" if count == 1 else f"the {count} oldest recordings"
            if any(files_of(run) for run in runs):
                what = "the oldest parts of what is recorded"
            return f"deleted {what} in {self._folder}, {size_text(freed)}, to keep within {limit}"
        if excess > 0 and not self._reported_full:
            self._reported_full = True
            return f"what is being recorded in {self._folder} alone exceeds {limit}; it is kept"
        return ""

    def _parts(self) -> list[PartFiles]:
        """Return the parts from the oldest, whatever their run; other files are ignored."""
        found: dict[str, list[Path]] = {}
        for path in self._folder.iterdir():
            if path.suffix in SUFFIXES and NAMED.match(path.stem):
                found.setdefault(path.stem, []).append(path)
        parts = [
            PartFiles(max(map(ended_ns, paths)), tuple(paths), sum(map(size_of, paths)))
            for _, paths in sorted(found.items())
        ]
        return sorted(parts, key=lambda part: part.ended_ns)


def ended_ns(path: Path) -> int:
    """Return when a file was last written, 0 when that cannot be read."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def size_of(path: Path) -> int:
    """Return the size of a file in bytes, 0 when it cannot be read."""
    try:
        return path.stat().st_size
    except OSError:
        return 0


def size_of_run(path: Path) -> int:
    """Return the size of the parts of a run that are of one kind, in bytes."""
    return sum(map(size_of, parts_of(path)))


def delete(part: PartFiles) -> bool:
    """Delete a part; return False when it is being written or cannot be deleted."""
    try:
        if any(map(is_being_written, part.files)):
            return False
        for path in part.files:
            path.unlink(missing_ok=True)
    except OSError:
        return False
    return True
