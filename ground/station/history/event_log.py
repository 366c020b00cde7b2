"""Keep events as lines in a bounded, searchable ring, and take frames from the bus's threads."""

from collections import deque
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Final, NamedTuple

from protocol.wire.enums import Severity

LINES: Final = 10_000
LETTERS: Final = "EEEEWIID"
"""The letter E, W, I or D of each severity, the worst first."""


class LogLine(NamedTuple):
    """`time_s` counts from the start of the station; `source` is the robot's name or `ground`.

    `clock_s` is the wall time in seconds of the epoch; None for a played recording.
    """

    time_s: float
    severity: int
    source: str
    text: str
    clock_s: float | None = None

    @property
    def letter(self) -> str:
        """Letter of the severity."""
        return LETTERS[max(0, min(self.severity, Severity.DEBUG))]


class EventLog:
    """The newest lines; `total` counts all lines ever added, so that readers find new ones.

    `began_s` is the wall time at which `time_s` of a line was 0; None without one.
    """

    def __init__(self, size: int = LINES, began_s: float | None = None) -> None:
        self._lines: deque[LogLine] = deque(maxlen=size)
        self.total = 0
        self._began_s = began_s

    def add(self, line: LogLine) -> None:
        """Append a line."""
        if self._began_s is not None:
            line = line._replace(clock_s=self._began_s + line.time_s)
        self._lines.append(line)
        self.total += 1

    def __len__(self) -> int:
        return len(self._lines)

    def __iter__(self) -> Iterator[LogLine]:
        return iter(self._lines)

    def since(self, total: int) -> list[LogLine]:
        """Return the lines added after there had been `total`, if they are still kept."""
        fresh = max(0, min(self.total - total, len(self._lines)))
        return list(islice(reversed(self._lines), fresh))[::-1]

    def last(self, count: int) -> list[LogLine]:
        """Return the newest lines."""
        return self.since(self.total - count)

    def find(self, words: str, worst: int = Severity.DEBUG) -> list[LogLine]:
        """Return the lines that contain these words in any case and are at least this severe."""
        wanted = words.casefold()
        return [
            line
            for line in self._lines
            if line.severity <= worst and wanted in f"{line.source} {line.text}".casefold()
        ]


SIZE: Final = 8192


class ReceivedFrame(NamedTuple):
    """A frame of a topic with its time of arrival."""

    path: str
    frame: bytes
    arrived_ns: int


class Inbox:
    """A ring that drops the oldest frames when full; both ends may be used concurrently."""

    def __init__(self, size: int = SIZE) -> None:
        self._ring: deque[ReceivedFrame] = deque(maxlen=size)

    def taker(self, path: str) -> Callable[[str, bytes, int], None]:
        """Return a handler for a topic; it runs in the bus's thread and only stores frames."""
        put = self._ring.append

        def take(_key: str, frame: bytes, arrived_ns: int) -> None:
            put(ReceivedFrame(path, frame, arrived_ns))

        return take

    def drain(self) -> tuple[list[ReceivedFrame], bool]:
        """Return all frames since the last call, and whether some of them were dropped."""
        ring = self._ring
        overflowed = len(ring) == ring.maxlen
        return [ring.popleft() for _ in range(len(ring))], overflowed
