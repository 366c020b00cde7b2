"""Read all frames of a recording of either kind: time of arrival, key and bytes.

A truncated file yields the frames before the cut, and `damage` describes the loss. A `.tlog` is
records of a big-endian time in us (8 bytes) and one MAVLink frame.

A recorder begins a new pair of files every so often. The first pair has the name of the run; the
later ones add `.part002` and so on. Whoever names one of them means the run. Retention may have
deleted the oldest.

The index holds a whole recording in compact form, so that any instant is found at once. Time starts
at 0 with the first frame. It is the time of arrival in wall time; in lockstep, which runs as fast
as the machine can, it is the stamp of the plant's clock.
"""

import fcntl
import os
import re
from array import array
from bisect import bisect_left, bisect_right
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from struct import Struct
from typing import BinaryIO, Final, NamedTuple, Protocol, cast

from ground.recording.bag_frames import BagFrames
from ground.recording.mcap_file import UNKNOWN_PATH, McapFile, path_in
from protocol.bus.network import MAX_ROBOTS
from protocol.ros_bag import is_bag
from protocol.topic import NAME, ROBOT_NAME
from protocol.topics import CLOCK, PREFIX, key_parts
from protocol.wire.codec import CHECKSUM_SIZE, HEADER_SIZE, MAGIC, SIGNATURE_SIZE, decode
from protocol.wire.message import Message
from protocol.wire.messages import SystemTime
from runtime.errors import RemoteError, UserError
from runtime.files import opened
from runtime.units import NS_PER_US

NAMED: Final = re.compile(
    rf"(?P<run>\d{{8}}T\d{{6}}Z-(?P<robot>{NAME})(\.\d{{1,3}})?)(\.part(?P<number>\d{{3,6}}))?\Z"
)
SUFFIXES: Final = (".mcap", ".tlog")
PART_BYTES: Final = 100 * 10**6
PART_S: Final = 3600.0
"""Size of both files, or age, at which a part ends."""


def run_of(path: Path) -> Path:
    """Return the path of the run's files without suffix, by the path of one of them."""
    named = NAMED.match(path.stem)
    return path.with_name(named["run"] if named else path.stem)


def number_of(path: Path) -> int:
    """Return the number of a part, from 1."""
    named = NAMED.match(path.stem)
    return int((named and named["number"]) or 1)


def part_of(path: Path, number: int) -> Path:
    """Return the path of another part of the same run and kind."""
    ending = "" if number == 1 else f".part{number:03}"
    return path.with_name(f"{run_of(path).name}{ending}{path.suffix}")


def parts_of(path: Path) -> list[Path]:
    """Return the parts of a run that exist, in order, of the same kind; else the path itself."""
    if NAMED.match(path.stem) is None:
        return [path]
    run = run_of(path)
    found = [
        part
        for part in path.parent.glob(f"{run.name}.*")
        if part.suffix == path.suffix and NAMED.match(part.stem) and run_of(part) == run
    ]
    return sorted(found, key=number_of) or [path]


def files_of(path: Path) -> list[Path]:
    """Return all files of a run or bag that exist."""
    if path.is_dir():
        return sorted(file for file in path.iterdir() if file.is_file())
    paths = [part for suffix in SUFFIXES for part in parts_of(path.with_suffix(suffix))]
    return [part for part in paths if part.is_file()]


STAMP: Final = Struct(">Q")
SIGNED: Final = 0x01
LARGEST_RECORD: Final = STAMP.size + HEADER_SIZE + 255 + CHECKSUM_SIZE + SIGNATURE_SIZE
CHUNK: Final = 1 << 18
TIME_LIMIT_US: Final = 1 << 56
"""No clock shows the year 4253, but one that was never set shows 1970."""
MAVLINK_1: Final = 0xFE
MAVLINK_1_BYTES: Final = 8
"""Of a frame without its payload."""


class Record(NamedTuple):
    """One frame and its time of arrival, microseconds since 1970 in UTC."""

    time_us: int
    frame: bytes


def record_bytes(time_us: int, frame: bytes) -> bytes:
    """Return the bytes of a record."""
    return STAMP.pack(time_us) + frame


def frame_size(head: bytes) -> int:
    """Return the size of a frame from its first three bytes or more; 0 for no frame."""
    if len(head) < 3 or head[0] != MAGIC:
        return 0
    return HEADER_SIZE + head[1] + CHECKSUM_SIZE + (SIGNATURE_SIZE if head[2] & SIGNED else 0)


def mavlink_1_size(head: bytes) -> int:
    """Return the size of a frame of MAVLink 1, which nothing here decodes; 0 for no such frame."""
    return MAVLINK_1_BYTES + head[1] if head[0] == MAVLINK_1 else 0


def is_whole_frame(frame: bytes) -> bool:
    """Return whether the bytes are exactly one frame, by the frame's own size."""
    return len(frame) > 0 and frame_size(frame) == len(frame)


class TlogReader:
    """Reads a log once from front to back; `lost_bytes` belong to no whole record."""

    def __init__(self, source: BinaryIO) -> None:
        self._source = source
        self._buffer = bytearray()
        self._at = 0
        self._ended = False
        self._in_step = True
        self.records = 0
        self.lost_bytes = 0
        self.gaps = 0

    def __iter__(self) -> Iterator[Record]:
        while self._available(LARGEST_RECORD + STAMP.size + 3):
            size = self._record_size()
            if size:
                yield self._take(size)
            else:
                self._skip()

    def _available(self, size: int) -> bool:
        """Buffer `size` bytes or the rest of the file; return False at its end."""
        if len(self._buffer) - self._at < size and not self._ended:
            del self._buffer[: self._at]
            self._at = 0
            chunk = self._source.read(CHUNK)
            self._buffer += chunk
            self._ended = not chunk
            if not self._ended:
                return self._available(size)
        return self._at < len(self._buffer)

    def _record_size(self) -> int:
        """Return the size of the whole record at the present position, 0 when there is none."""
        size = self._claimed_size(self._at)
        end = self._at + size
        if not size or end > len(self._buffer):
            return 0
        if _decodes(bytes(self._buffer[self._at + STAMP.size : end])):
            return size
        # A frame of a newer dialect cannot be checked; accept it if another record follows.
        followed = end == len(self._buffer) or self._claimed_size(end)
        return size if self._in_step and followed else 0

    def _claimed_size(self, at: int) -> int:
        """Return the size that a record at a position claims; 0 when there is no record."""
        head = bytes(self._buffer[at : at + STAMP.size + 3])
        if len(head) < STAMP.size + 3:
            return 0
        (time_us,) = STAMP.unpack_from(head)
        size = frame_size(head[STAMP.size :]) or mavlink_1_size(head[STAMP.size :])
        return STAMP.size + size if size and time_us < TIME_LIMIT_US else 0

    def _take(self, size: int) -> Record:
        (time_us,) = STAMP.unpack_from(self._buffer, self._at)
        frame = bytes(self._buffer[self._at + STAMP.size : self._at + size])
        self._at += size
        self._in_step = True
        self.records += 1
        return Record(time_us, frame)

    def _skip(self) -> None:
        """Move to the next byte at which a record may begin."""
        self.gaps += self._in_step
        self._in_step = False
        magic = self._buffer.find(MAGIC, self._at + 1 + STAMP.size)
        nowhere = max(self._at + 1, len(self._buffer) - STAMP.size)
        place = nowhere if magic < 0 else magic - STAMP.size
        self.lost_bytes += place - self._at
        self._at = place

    def damage(self) -> str:
        """Return what was lost, in words; empty when nothing was lost."""
        if not self.lost_bytes:
            return ""
        places = "one place" if self.gaps == 1 else f"{self.gaps} places"
        return f"{self.lost_bytes} bytes in {places} belong to no whole record and were skipped"


def read(path: Path) -> Iterator[Record]:
    """Yield the whole records of a file."""
    with opened(path) as source:
        yield from TlogReader(source)


def _decodes(frame: bytes) -> bool:
    try:
        decode(frame)
    except RemoteError:
        return False
    return True


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


class BagLog(BagFrames):
    """A bag of ROS 2."""

    def __init__(self, path: Path, robot: str | None) -> None:
        super().__init__(path, robot)
        self.lost_bytes = 0

    def __iter__(self) -> Iterator[LoggedFrame]:
        for time_ns, key, frame in self.frames():
            yield LoggedFrame(time_ns, key, frame)


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
    if is_bag(path):
        return BagLog(path, robot)
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
    path = f"{UNKNOWN_PATH}/mavlink1" if frame[0] == MAVLINK_1 else path_in(frame)
    return f"{PREFIX}/{robot}/{path}"


REPORT_EVERY: Final = 1000
"""Number of frames between two reports of progress."""
MAX_TIME_NS: Final = 1 << 62
"""Upper limit for a damaged time."""


class IndexedFrame(NamedTuple):
    """One frame with its time on the timeline."""

    time_ns: int
    key: str
    frame: bytes


class LogIndex:
    """Frames in order, with an index by key. There may be several robots; one was recorded."""

    def __init__(self, log: Log, progress: Callable[[float], None] = lambda _: None) -> None:
        """Read the log; `progress` receives the share of the file that was read."""
        self._keys: list[str] = []
        self._key_of = array("I")
        self._times_ns = array("q")
        self._ends = array("Q")
        self._blob = bytearray()
        self._places: dict[str, array[int]] = {}
        self.start_ns = 0
        """Time of arrival of the first frame, in UTC."""
        self._fill(log, progress)
        self.robot = log.robot
        self._keys_of: dict[tuple[str, str], list[str]] = {}
        for key in self._keys:
            parts = key_parts(key)
            if parts is not None and ROBOT_NAME.match(parts.robot):
                self._keys_of.setdefault((parts.robot, parts.path), []).append(key)
        others = sorted({robot for robot, _ in self._keys_of} - {self.robot})
        self.robots = (self.robot, *others[:MAX_ROBOTS])
        """Names of the recorded robot and of others of which there are frames."""
        self.facts = dict(log.facts)
        self.damage = log.damage()

    def _fill(self, log: Log, progress: Callable[[float], None]) -> None:
        numbers: dict[str, int] = {}
        plant = PlantClock()
        stamps_ns = array("q")
        arrived_ns = 0
        for place, one in enumerate(log):
            if place % REPORT_EVERY == 0:
                progress(log.share)
            self.start_ns = self.start_ns or one.time_ns
            arrived_ns = min(max(arrived_ns, one.time_ns - self.start_ns), MAX_TIME_NS)
            self._times_ns.append(arrived_ns)
            stamps_ns.append(plant.update(one))
            self._key_of.append(numbers.setdefault(one.key, len(numbers)))
            self._blob += one.frame
            self._ends.append(len(self._blob))
            self._places.setdefault(one.key, array("Q")).append(place)
        self._keys = list(numbers)
        if plant.is_running:
            self._times_ns = stamps_ns

    def __len__(self) -> int:
        return len(self._times_ns)

    def __getitem__(self, place: int) -> IndexedFrame:
        begin = self._ends[place - 1] if place else 0
        frame = bytes(self._blob[begin : self._ends[place]])
        return IndexedFrame(self._times_ns[place], self._keys[self._key_of[place]], frame)

    def key(self, place: int) -> str:
        """Return the key of the frame at an index."""
        return self._keys[self._key_of[place]]

    @property
    def duration_ns(self) -> int:
        """Time of the last frame in ns."""
        return self._times_ns[-1] if self._times_ns else 0

    def after(self, time_ns: int) -> int:
        """Return the index of the first frame later than this time."""
        return bisect_right(self._times_ns, time_ns)

    def _newest(self, key: str, before: int) -> IndexedFrame | None:
        """Return the last frame with a key before an index."""
        places = self._places.get(key)
        found = 0 if places is None else bisect_left(places, before)
        return None if places is None or not found else self[places[found - 1]]

    def newest_on(self, path: str, before: int, robot: str = "") -> IndexedFrame | None:
        """Return the last frame on a topic path of a robot, of any operator, before an index."""
        keys = self._keys_on(path, robot)
        found = [played for key in keys if (played := self._newest(key, before)) is not None]
        return max(found, key=lambda played: played.time_ns, default=None)

    def times_ns(self, path: str) -> list[int]:
        """Return the times of all frames on a topic path, readable or not."""
        return [self._times_ns[place] for key in self._keys_on(path) for place in self._places[key]]

    def _keys_on(self, path: str, robot: str = "") -> list[str]:
        """Return the keys with a topic path, of a robot, by default of the recorded one."""
        return self._keys_of.get((robot or self.robot, path), [])

    def on(self, path: str) -> Iterator[tuple[int, Message]]:
        """Yield time and message of all readable frames on a topic path."""
        for place in chain.from_iterable(self._places[key] for key in self._keys_on(path)):
            played = self[place]
            try:
                yield played.time_ns, decode(played.frame).message
            except RemoteError:
                continue


class PlantClock:
    """The plant's clock, whose frames exist in lockstep only; it starts at 0."""

    def __init__(self) -> None:
        self.is_running = False
        self._first_ns = 0
        self._now_ns = 0

    def update(self, one: LoggedFrame) -> int:
        """Return the newest stamp at the time of this frame."""
        if one.key.endswith(CLOCK.path):
            with suppress(RemoteError):
                message = decode(one.frame).message
                if isinstance(message, SystemTime):
                    self._advance(message.time_unix_usec * NS_PER_US)
        return self._now_ns

    def _advance(self, stamp_ns: int) -> None:
        if not self.is_running:
            self.is_running, self._first_ns = True, stamp_ns
        self._now_ns = min(max(self._now_ns, stamp_ns - self._first_ns), MAX_TIME_NS)
