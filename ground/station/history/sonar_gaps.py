"""Store which sonars recently had no reading, so that their display does not flicker."""

from collections import deque
from functools import reduce
from operator import and_
from typing import Final

from protocol.wire.messages import SonarScan

HELD: Final = 10
"""A sonar counts as silent until it has had a reading in this number of consecutive scans."""
ALL: Final = 0xFF


class SonarGaps:
    """Stores which sonars were valid in the last scans."""

    def __init__(self) -> None:
        self._valid: deque[int] = deque(maxlen=HELD)

    def add(self, scan: SonarScan) -> None:
        """Add the next scan."""
        self._valid.append(scan.valid)

    @property
    def silent(self) -> int:
        """A bit for each sonar, 1 if one of the last scans has no reading of it."""
        return ALL & ~reduce(and_, self._valid, ALL)
