"""Remember which sonars gave no reading lately, so that a display of them does not blink."""

from collections import deque
from functools import reduce
from operator import and_
from typing import Final

from protocol.wire.messages import SonarScan

HELD: Final = 10
"""A sonar counts as silent until it has given a reading in so many scans in sequence."""
ALL: Final = 0xFF


class SonarGaps:
    """Keeps which sonars were valid in the last scans."""

    def __init__(self) -> None:
        self._valid: deque[int] = deque(maxlen=HELD)

    def add(self, scan: SonarScan) -> None:
        """Add the next scan."""
        self._valid.append(scan.valid)

    @property
    def silent(self) -> int:
        """A bit for each sonar, 1 if one of the last scans has no reading of it."""
        return ALL & ~reduce(and_, self._valid, ALL)
