"""Every frame of a recording, whatever its kind: when it arrived, on which key, and its bytes.

A file that was cut off anywhere gives the frames before the cut, and `damage` says what is lost.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from ground.recording.frame_paths import path_in
from ground.recording.mcap.reader import McapFile
from ground.recording.tlog import Reader
from protocol.topic import NAME
from protocol.topics import PREFIX
from runtime.errors import UserError
from runtime.units import NS_PER_US

MCAP_BEGINS: Final = b"\x89MCAP"
NAMED: Final = re.compile(rf"\d{{8}}T\d{{6}}Z-(?P<robot>{NAME})(\.\d{{1,3}})?\Z")
USUAL_ROBOT: Final = "r1"


class Frame(NamedTuple):
    """One frame; `time_ns` is when it reached the recorder, in UTC since 1970."""

    time_ns: int
    key: str
    frame: bytes


class Log(Protocol):
    """A recording, read once from front to back. What it lost is known when it has been read."""

    @property
    def robot(self) -> str: ...
    @property
    def facts(self) -> Mapping[str, str]:
        """What was recorded beside the frames, as JSON texts: `world` and `parameters`."""
        ...

    @property
    def records(self) -> int: ...
    @property
    def lost_bytes(self) -> int: ...
    def __iter__(self) -> Iterator[Frame]: ...
    def damage(self) -> str:
        """What was lost, in words; empty when nothing was."""
        ...


class TlogLog:
    """A `.tlog`. It has no keys: they follow from what a frame carries and who sent it.

    It has no place for facts either: they are those of the `.mcap` of the same run beside it.
    """

    def __init__(self, path: Path, robot: str) -> None:
        self.robot = robot
        self.facts = facts_beside(path)
        self._path = path
        self._reader: Reader | None = None

    def __iter__(self) -> Iterator[Frame]:
        with self._path.open("rb") as source:
            self._reader = Reader(source)
            for time_us, frame in self._reader:
                yield Frame(time_us * NS_PER_US, key_of(frame, self.robot), frame)

    @property
    def records(self) -> int:
        return 0 if self._reader is None else self._reader.records

    @property
    def lost_bytes(self) -> int:
        return 0 if self._reader is None else self._reader.lost_bytes

    def damage(self) -> str:
        return "" if self._reader is None else self._reader.damage()


class McapLog:
    """An `.mcap` of ours; `facts` are the texts that were recorded beside the frames.

    Whatever prefix the keys had on the bus, here they have the usual one.
    """

    def __init__(self, path: Path, robot: str) -> None:
        self.robot = robot
        self.records = 0
        self._file = McapFile(path)
        self.facts = self._file.facts

    def __iter__(self) -> Iterator[Frame]:
        for time_ns, raw in self._file:
            self.records += 1
            path = raw.key.partition(f"/{self.robot}/")[2]
            yield Frame(time_ns, f"{PREFIX}/{self.robot}/{path}" if path else raw.key, raw.frame)

    @property
    def lost_bytes(self) -> int:
        return self._file.lost_bytes

    def damage(self) -> str:
        return self._file.damage()


def opened(path: Path, robot: str | None = None) -> Log:
    """The recording in a file, by what it begins with; UserError when it cannot be opened."""
    try:
        with path.open("rb") as source:
            begin = source.read(len(MCAP_BEGINS))
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    if begin == MCAP_BEGINS or (path.suffix == ".mcap" and MCAP_BEGINS.startswith(begin)):
        return McapLog(path, robot or McapFile(path).robot() or robot_in(path))
    return TlogLog(path, robot or robot_in(path))


def facts_beside(path: Path) -> dict[str, str]:
    """The facts of the `.mcap` of the same name; none when it is not there."""
    try:
        return McapFile(path.with_suffix(".mcap")).facts_alone()
    except OSError:
        return {}


def frames(path: Path) -> Iterator[Frame]:
    """All frames of a recording, in the order in which they arrived."""
    return iter(opened(path))


def robot_in(path: Path) -> str:
    """The robot that a recording is named after; the usual one when the name does not tell."""
    named = NAMED.match(path.stem)
    return named["robot"] if named else USUAL_ROBOT


def key_of(frame: bytes, robot: str) -> str:
    """The key that a frame was published on, as far as message and sender tell."""
    return f"{PREFIX}/{robot}/{path_in(frame)}"
