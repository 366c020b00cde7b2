"""What has happened, in lines: a bounded ring that can be searched."""

from collections import deque
from collections.abc import Iterator
from itertools import islice
from typing import Final, NamedTuple

from protocol.wire.enums import Severity

LINES: Final = 10_000
LETTERS: Final = "EEEEWIID"
"""E, W, I or D for each severity, the worst first."""


class Line(NamedTuple):
    """`time_s` counts from the start of the station; `source` is the robot's name or `ground`."""

    time_s: float
    severity: int
    source: str
    text: str

    @property
    def letter(self) -> str:
        return LETTERS[max(0, min(self.severity, Severity.DEBUG))]


class Log:
    """The newest lines; `total` counts all there ever were, so that a reader sees what is new."""

    def __init__(self, size: int = LINES) -> None:
        self._lines: deque[Line] = deque(maxlen=size)
        self.total = 0

    def add(self, line: Line) -> None:
        self._lines.append(line)
        self.total += 1

    def __len__(self) -> int:
        return len(self._lines)

    def __iter__(self) -> Iterator[Line]:
        return iter(self._lines)

    def since(self, total: int) -> list[Line]:
        """The lines that came after there had been `total`, as far as they are still kept."""
        fresh = max(0, min(self.total - total, len(self._lines)))
        return list(islice(reversed(self._lines), fresh))[::-1]

    def last(self, count: int) -> list[Line]:
        return self.since(self.total - count)

    def find(self, words: str, worst: int = Severity.DEBUG) -> list[Line]:
        """The kept lines that hold these words in any case and are at least so severe."""
        wanted = words.casefold()
        return [
            line
            for line in self._lines
            if line.severity <= worst and wanted in f"{line.source} {line.text}".casefold()
        ]
