"""Keep the robot's decisions of the last minutes, to explain any instant."""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice, takewhile
from typing import Final, NamedTuple, TypeVar

from ground.station.history.event_log import ReceivedFrame
from protocol.topics import CYCLE, DECISION, STATUS
from protocol.wire.codec import decode
from protocol.wire.message import Message
from protocol.wire.messages import AvoidanceDecision, CycleReport, NavigatorStatus
from runtime.errors import RemoteError

MAX_FRAMES: Final = 12_000
"""Ten minutes at 20 Hz."""
NEAR_NS: Final = 1_000_000_000
FAR_NS: Final = 1 << 63
AT_ONCE: Final = 2_400
"""Most decisions decoded in one call: two minutes, which takes a few hundredths of a second."""

M = TypeVar("M", bound=Message)


class Moment(NamedTuple):
    """A decision, the one before it, and the robot's state at that time."""

    time_ns: int
    decision: AvoidanceDecision
    previous: AvoidanceDecision | None
    status: NavigatorStatus | None
    cycle: CycleReport | None


class Frames:
    """Frames of one topic with their times of arrival, decoded only on request."""

    def __init__(self) -> None:
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=MAX_FRAMES)

    def add(self, frame: bytes, arrived_ns: int) -> None:
        """Append a frame."""
        self._kept.append((arrived_ns, frame))

    def __len__(self) -> int:
        return len(self._kept)

    def until(self, time_ns: int) -> Iterator[tuple[int, Message]]:
        """Yield the messages that had arrived by then, newest first; skip malformed ones."""
        end = bisect_right(self._kept, time_ns, key=lambda pair: pair[0])
        for arrived_ns, frame in islice(reversed(self._kept), len(self._kept) - end, None):
            with suppress(RemoteError):
                yield arrived_ns, decode(frame).message

    def at(self, time_ns: int, kind: type[M]) -> M | None:
        """Return the newest message at that time; None when it was more than 1 s old."""
        arrived_ns, message = next(self.until(time_ns), (time_ns, None))
        near = time_ns - arrived_ns <= NEAR_NS
        return message if near and isinstance(message, kind) else None


class DecisionHistory:
    """The frames that describe decisions: decisions, status, cycle reports."""

    def __init__(self) -> None:
        topics = (DECISION, STATUS, CYCLE)
        self._frames = {topic.path: Frames() for topic in topics}

    def take(self, arrival: ReceivedFrame) -> None:
        """Keep a frame if its topic describes decisions."""
        frames = self._frames.get(arrival.path)
        if frames is not None:
            frames.add(arrival.frame, arrival.arrived_ns)

    def decisions(self, after_ns: int) -> list[tuple[int, AvoidanceDecision]]:
        """Return decisions that arrived later with their times, oldest first; at most `AT_ONCE`."""
        kept = islice(self._frames[DECISION.path].until(FAR_NS), AT_ONCE)
        newer = takewhile(lambda pair: pair[0] > after_ns, kept)
        found = [(at_ns, one) for at_ns, one in newer if isinstance(one, AvoidanceDecision)]
        return found[::-1]

    def at(self, time_ns: int) -> Moment | None:
        """Return the decision in force at that instant, or None when it is not kept."""
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
        )
