"""Read all frames of a recording of either kind: time of arrival, key and bytes.

A truncated file yields the frames before the cut, and `damage` describes the loss.
"""

import fcntl
import os
from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple, Protocol, cast

from ground.recording.frame_paths import path_in
from ground.recording.mcap.reader import McapFile
from ground.recording.parts import NAMED, SUFFIXES, number_of, parts_of
from ground.recording.tlog import TlogReader
from protocol.topics import PREFIX, key_parts
from runtime.errors import UserError
from runtime.files import opened
from runtime.units import NS_PER_US

MCAP_BEGINS: Final = b"\x89MCAP"
USUAL_ROBOT: Final = "r1"


class LoggedFrame(NamedTuple):
    """One frame; `time_ns` is its arrival at the recorder, in UTC since 1970."""

    time_ns: int
    key: str
    frame: bytes


class Log(Protocol):
    """A recording, read once from front to back; losses are complete after reading."""

    @property
    def robot(self) -> str:
        """Name of the robot."""
        ...

    @property
    def facts(self) -> Mapping[str, str]:
        """Facts recorded beside the frames, as JSON texts: `world` and `parameters`."""
        ...

    @property
    def records(self) -> int:
        """Number of frames read so far."""
        ...

    @property
    def share(self) -> float:
        """Share of the file that was read, 0 to 1."""
        ...

    @property
    def lost_bytes(self) -> int:
        """Number of bytes lost so far."""
        ...

    def __iter__(self) -> Iterator[LoggedFrame]: ...
    def damage(self) -> str:
        """Return what was lost, in words; empty when nothing was lost."""
        ...


class TlogLog:
    """A `.tlog`; its keys are derived from message and sender of each frame.

    It cannot hold facts: they come from the `.mcap` of the same run beside it.
    """

    def __init__(self, path: Path, robot: str) -> None:
        self.robot = robot
        self.facts = sibling_facts(path)
        self._path = path
        self._reader: TlogReader | None = None
        self.share = 0.0

    def __iter__(self) -> Iterator[LoggedFrame]:
        size = max(1, self._path.stat().st_size)
        with opened(self._path) as source:
            self._reader = TlogReader(source)
            for time_us, frame in self._reader:
                self.share = source.tell() / size
                yield LoggedFrame(time_us * NS_PER_US, key_of(frame, self.robot), frame)

    @property
    def records(self) -> int:
        """Number of frames read."""
        return 0 if self._reader is None else self._reader.records

    @property
    def lost_bytes(self) -> int:
        """Number of bytes that belong to no whole record."""
        return 0 if self._reader is None else self._reader.lost_bytes

    def damage(self) -> str:
        """Return what was lost, in words."""
        return "" if self._reader is None else self._reader.damage()


class McapLog(McapFile):
    """An `.mcap` file; `facts` are the texts recorded beside the frames.

    Keys get the standard prefix, whatever prefix they had on the bus.
    """

    def __init__(self, path: Path, robot: str) -> None:
        super().__init__(path)
        self.robot = robot
        self.records = 0
        self._is_running = is_locked(path)

    def __iter__(self) -> Iterator[LoggedFrame]:
        for time_ns, raw in self.frames():
            self.records += 1
            yield LoggedFrame(time_ns, standard_key(raw.key, self.robot), raw.frame)

    def damage(self) -> str:
        """Return a description of the damage.

        A file that is still being recorded is not closed yet.
        """
        return "" if self._is_running and not self.lost_bytes else super().damage()


def standard_key(key: str, robot: str) -> str:
    """Return a key with the standard prefix; a key of no topic of any robot stays as it is."""
    path = key.partition(f"/{robot}/")[2]
    if path:
        return f"{PREFIX}/{robot}/{path}"
    parts = key_parts(key)
    if parts is None:
        return key
    return "/".join(filter(None, (PREFIX, parts.robot, parts.path, parts.operator)))


class RunLog:
    """Several parts of one run, read one after the other."""

    def __init__(self, paths: Sequence[Path], robot: str | None) -> None:
        self._logs = {number_of(path): open_part(path, robot) for path in paths}
        self._sizes = [path.stat().st_size for path in paths]
        self._read = 0
        self.robot = next(iter(self._logs.values())).robot
        facts = [cast(dict[str, str], log.facts) for log in self._logs.values()]
        self.facts: Mapping[str, str] = ChainMap(*facts)
        """The facts of all parts, as the earliest one has them; they grow while reading."""

    def __iter__(self) -> Iterator[LoggedFrame]:
        self._read = 0
        for log in self._logs.values():
            yield from log
            self._read += 1

    @property
    def records(self) -> int:
        """Number of frames read so far."""
        return sum(log.records for log in self._logs.values())

    @property
    def share(self) -> float:
        """Share of the files that was read."""
        logs = [*self._logs.values()]
        current = logs[self._read].share if self._read < len(logs) else 0.0
        read = sum(self._sizes[: self._read]) + current * sum(self._sizes[self._read :][:1])
        return read / max(1, sum(self._sizes))

    @property
    def lost_bytes(self) -> int:
        """Number of bytes lost so far."""
        return sum(log.lost_bytes for log in self._logs.values())

    def damage(self) -> str:
        """Return what was lost, in words. The oldest parts may have been deleted (`--keep`)."""
        found = []
        for number in range(min(self._logs), max(self._logs) + 1):
            log = self._logs.get(number)
            words = "is missing" if log is None else log.damage()
            found += [f"part {number}: {words}"] if words else []
        return "; ".join(found)


def open_log(path: Path, robot: str | None = None) -> Log:
    """Open the recording of a run by the path of one of its files.

    Raises UserError when it cannot be opened.
    """
    parts = parts_of(path)
    return open_part(parts[0], robot) if len(parts) == 1 else RunLog(parts, robot)


def open_part(path: Path, robot: str | None = None) -> Log:
    """Open one file; its first bytes decide the kind. UserError when it cannot be opened."""
    try:
        with opened(path) as source:
            begin = source.read(len(MCAP_BEGINS))
    except OSError as error:
        raise UserError(
            f"{path}: {error.strerror}: name a recording, as listed by `sidestep rec list`"
        ) from error
    if path.suffix not in SUFFIXES and begin != MCAP_BEGINS and not begins_with_record(path):
        raise UserError(f"{path}: is not a recording, which is a .mcap or a .tlog")
    if begin == MCAP_BEGINS or (path.suffix == ".mcap" and MCAP_BEGINS.startswith(begin)):
        return McapLog(path, robot or McapFile(path).robot_in_header() or robot_in(path))
    return TlogLog(path, robot or robot_in(path))


def begins_with_record(path: Path) -> bool:
    """Return whether the file begins like a .tlog, whatever its name."""
    with opened(path) as source:
        reader = TlogReader(source)
        return next(iter(reader), None) is not None and not reader.lost_bytes


def sibling_facts(path: Path) -> dict[str, str]:
    """Return the facts of the `.mcap` of the same name; empty when there is none."""
    try:
        return McapFile(path.with_suffix(".mcap")).read_facts()
    except OSError:
        return {}


def robot_in(path: Path) -> str:
    """Return the robot in a recording's file name, or the default robot."""
    named = NAMED.match(path.stem)
    return named["robot"] if named else USUAL_ROBOT


def is_being_written(path: Path) -> bool:
    """Return whether a recorder holds its lock on a file; OSError when that is unknown."""
    fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(fd)
    return False


def is_running(path: Path) -> bool:
    """Return whether the run of a file is certainly still being recorded."""
    return is_locked(parts_of(path)[-1])


def is_locked(path: Path) -> bool:
    """Return whether a file is certainly being written."""
    try:
        return is_being_written(path)
    except OSError:
        return False


def key_of(frame: bytes, robot: str) -> str:
    """Return the key of a frame, derived from message and sender."""
    return f"{PREFIX}/{robot}/{path_in(frame)}"
