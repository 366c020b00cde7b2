"""The robot's decisions of the last minutes, so that any instant can be asked why."""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice, takewhile
from typing import Final, NamedTuple, TypeVar

from ground.station.history.inbox import Arrival
from protocol.topics import CYCLE, DECISION, ODOMETRY, STATUS
from protocol.wire.codec import decode
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CycleReport,
    NavigatorStatus,
    PlanarOdometry,
)
from runtime.errors import RemoteError

KEPT: Final = 12_000
"""Ten minutes at 20 Hz."""
NEAR_NS: Final = 1_000_000_000
FAR_NS: Final = 1 << 63
AT_ONCE: Final = 2_400
"""Decisions that are decoded in one go: two minutes, in a few hundredths of a second."""

M = TypeVar("M", bound=Message)


class Moment(NamedTuple):
    """One instant: what was decided, by a robot in which state and where, and what before it."""

    time_ns: int
    decision: AvoidanceDecision
    previous: AvoidanceDecision | None
    status: NavigatorStatus | None
    cycle: CycleReport | None
    odometry: PlanarOdometry | None


class Frames:
    """Frames of one topic with their arrival, decoded only when somebody looks back."""

    def __init__(self, size: int = KEPT) -> None:
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=size)

    def add(self, frame: bytes, arrived_ns: int) -> None:
        self._kept.append((arrived_ns, frame))

    def __len__(self) -> int:
        return len(self._kept)

    def until(self, time_ns: int) -> Iterator[tuple[int, Message]]:
        """What had arrived by then, the newest first; what cannot be read is left out."""
        end = bisect_right(self._kept, time_ns, key=lambda pair: pair[0])
        for arrived_ns, frame in islice(reversed(self._kept), len(self._kept) - end, None):
            with suppress(RemoteError):
                yield arrived_ns, decode(frame).message

    def at(self, time_ns: int, kind: type[M]) -> M | None:
        """The newest one of then; None when the one there is had already been old."""
        arrived_ns, message = next(self.until(time_ns), (time_ns, None))
        near = time_ns - arrived_ns <= NEAR_NS
        return message if near and isinstance(message, kind) else None


class Moments:
    """The frames that together tell what was decided."""

    def __init__(self, size: int = KEPT) -> None:
        topics = (DECISION, STATUS, CYCLE, ODOMETRY)
        self._frames = {topic.path: Frames(size) for topic in topics}

    def take(self, arrival: Arrival) -> None:
        frames = self._frames.get(arrival.path)
        if frames is not None:
            frames.add(arrival.frame, arrival.arrived_ns)

    def decisions(self, after_ns: int) -> list[tuple[int, AvoidanceDecision]]:
        """Those that arrived later, with when they did, the oldest first; at most `AT_ONCE`."""
        kept = islice(self._frames[DECISION.path].until(FAR_NS), AT_ONCE)
        newer = takewhile(lambda pair: pair[0] > after_ns, kept)
        found = [(at_ns, one) for at_ns, one in newer if isinstance(one, AvoidanceDecision)]
        return found[::-1]

    def at(self, time_ns: int) -> Moment | None:
        """The decision in force at that instant; None when none is kept from then."""
        found = islice(self._frames[DECISION.path].until(time_ns), 2)
        decisions = [
            (arrived_ns, message)
            for arrived_ns, message in found
            if isinstance(message, AvoidanceDecision) and time_ns - arrived_ns <= NEAR_NS
        ]
        if not decisions:
            return None
        arrived_ns, decision = decisions[0]
        return Moment(
            arrived_ns,
            decision,
            decisions[1][1] if len(decisions) > 1 else None,
            self._frames[STATUS.path].at(time_ns, NavigatorStatus),
            self._frames[CYCLE.path].at(time_ns, CycleReport),
            self._frames[ODOMETRY.path].at(time_ns, PlanarOdometry),
        )
