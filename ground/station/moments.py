"""The robot's decisions of the last minutes, so that any instant can be asked why."""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from typing import Final, NamedTuple

from protocol.codec import decode
from protocol.errors import RemoteError
from protocol.messages import AvoidanceDecision, CycleReport, NavigatorStatus, PlanarOdometry

KEPT: Final = 12_000


class Moment(NamedTuple):
    """One instant: what was decided, by a robot in which state and where, and what before it."""

    time_ns: int
    decision: AvoidanceDecision
    previous: AvoidanceDecision | None
    status: NavigatorStatus | None
    cycle: CycleReport | None
    odometry: PlanarOdometry | None


class Frames:
    """Frames of one topic with their arrival, undecoded: the bus appends, a reader looks back."""

    def __init__(self, size: int = KEPT) -> None:
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=size)

    def put(self, frame: bytes, arrived_ns: int) -> None:
        self._kept.append((arrived_ns, frame))

    def __len__(self) -> int:
        return len(self._kept)

    def clear(self) -> None:
        self._kept.clear()

    def until(self, time_ns: int) -> Iterator[tuple[int, object]]:
        """What had arrived by then, the newest first, decoded; unreadable frames are left out."""
        kept = self._kept.copy()
        for at in range(bisect_right(kept, time_ns, key=lambda pair: pair[0]) - 1, -1, -1):
            with suppress(RemoteError):
                yield kept[at][0], decode(kept[at][1]).message
