"""Put all messages of a recording on one time axis: seconds of the robot's stamps.

A message without a stamp gets the newest stamp before it. Stamps of operators belong to another
clock and are ignored.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

from ground.recording.log_reader import Log, LoggedFrame
from protocol.topics import TOPICS, Role
from protocol.wire.codec import decode
from protocol.wire.message import Message
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

OPERATOR_PATHS: Final = tuple(f"/{one.path}" for one in TOPICS if one.publisher is Role.GROUND)


class Timed(NamedTuple):
    """A message, its topic path, its time on the axis, and its time of arrival in UTC."""

    time_s: float
    utc_s: float
    path: str
    message: Message


class TimeAxis:
    """Reads a recording once; messages that cannot be decoded are counted in `unreadable`."""

    def __init__(self, log: Log, begin_s: float | None = None, end_s: float | None = None) -> None:
        self.log = log
        self.unreadable = 0
        self._begin_s = float("-inf") if begin_s is None else begin_s
        self._end_s = float("inf") if end_s is None else end_s

    def __iter__(self) -> Iterator[Timed]:
        for timed in self._all():
            if self._begin_s <= timed.time_s <= self._end_s:
                yield timed

    def _all(self) -> Iterator[Timed]:
        unstamped: list[tuple[LoggedFrame, Message]] = []
        newest_ns: int | None = None
        for frame in self.log:
            try:
                message = decode(frame.frame).message
            except RemoteError:
                self.unreadable += 1
                continue
            stamp_ns = newest_ns
            if not frame.key.endswith(OPERATOR_PATHS):
                stamp_ns = getattr(message, "time_ns", newest_ns)
            if stamp_ns is None:
                unstamped.append((frame, message))
                continue
            for before in unstamped:
                yield self._timed(*before, stamp_ns)
            unstamped.clear()
            newest_ns = stamp_ns
            yield self._timed(frame, message, stamp_ns)
        for before in unstamped:
            yield self._timed(*before, 0)

    def _timed(self, frame: LoggedFrame, message: Message, stamp_ns: int) -> Timed:
        path = frame.key.partition(f"/{self.log.robot}/")[2] or frame.key
        return Timed(stamp_ns / NS_PER_S, frame.time_ns / NS_PER_S, path, message)
