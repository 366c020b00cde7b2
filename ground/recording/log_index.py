"""Hold a whole recording in compact form in memory, so that any instant is found at once.

Time starts at 0 with the first frame. It is the time of arrival in wall time. In lockstep, which
runs as fast as the machine can, it is the stamp of the plant's clock.
"""

from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import chain
from typing import Final, NamedTuple

from ground.recording.log_reader import Log, LoggedFrame
from protocol.bus.network import MAX_ROBOTS
from protocol.topic import ROBOT_NAME
from protocol.topics import CLOCK, key_parts
from protocol.wire.codec import decode
from protocol.wire.message import Message
from protocol.wire.messages import SystemTime
from runtime.errors import RemoteError
from runtime.units import NS_PER_US

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
