"""Measure rate and loss of each topic from arrivals and gaps in sequence numbers."""

from collections import deque
from collections.abc import Iterable
from typing import Any, Final, NamedTuple

from ground.client.telemetry import Age, Telemetry
from ground.station.history.event_log import ReceivedFrame
from protocol.topics import Role, Topic
from protocol.wire.codec import is_frame
from runtime.units import NS_PER_S

WINDOW_NS: Final = 5 * NS_PER_S
MAX_FRAMES: Final = 512
SEQUENCE_AT: Final = 4
"""Position of the sequence byte in a MAVLink 2 frame; each publisher counts its own frames."""
SLACK: Final = 2


class StreamRow(NamedTuple):
    """One line of the Links screen; rate and loss cover the last seconds, counts all time.

    `rate_hz` is None for events and for topics without any message.
    """

    topic: Topic[Any]
    rate_hz: float | None
    age_ns: int | None
    age: Age
    received: int
    lost: int
    lost_percent: float
    rejected: int
    last_rejection: str


class StreamCounter:
    """Counts one topic; a gap in its sequence is a loss, unless the sender was restarted."""

    def __init__(self, topic: Topic[Any]) -> None:
        self.topic = topic
        self.received = self.lost = 0
        self._arrivals: deque[int] = deque(maxlen=MAX_FRAMES)
        self._gaps: deque[tuple[int, int]] = deque(maxlen=MAX_FRAMES)
        self._last: tuple[int, int] | None = None

    def take(self, frame: bytes, arrived_ns: int) -> None:
        """Count a frame."""
        if not is_frame(frame):
            return
        if self._last is not None and arrived_ns < self._last[1]:
            self._fetched(frame[SEQUENCE_AT], *self._last)
            return
        sequence = frame[SEQUENCE_AT]
        missing = self._missing(sequence, arrived_ns)
        if missing:
            self.lost += missing
            self._gaps.append((arrived_ns, missing))
        self._last = sequence, arrived_ns
        self.received += 1
        self._arrivals.append(arrived_ns)

    def _fetched(self, sequence: int, last: int, now_ns: int) -> None:
        """Count a cached sample: it is older than the arrival of the last frame, and was not lost.

        It is the next one if the last frame had waited for others that were fetched.
        """
        self.received += 1
        if sequence == (last + 1) & 0xFF:
            self._last = sequence, now_ns
        elif self.lost:
            self.lost -= 1
            self._gaps.append((now_ns, -1))

    def skip(self) -> None:
        """Ignore the next gap: frames were dropped on this side, or another process counts."""
        self._last = None

    def _missing(self, sequence: int, arrived_ns: int) -> int:
        """Return the number of missing frames; 0 on keys that several operators share."""
        if self._last is None or self.topic.publisher is Role.GROUND:
            return 0
        last, before_ns = self._last
        missing = (sequence - last - 1) & 0xFF
        most = SLACK + 2 * self.topic.rate_hz * (arrived_ns - before_ns) / NS_PER_S
        return 0 if sequence == 0 or missing > most else missing

    def recent(self, now_ns: int) -> tuple[int, int]:
        """Return the numbers of received and lost frames in the last seconds."""
        while self._arrivals and now_ns - self._arrivals[0] > WINDOW_NS:
            self._arrivals.popleft()
        while self._gaps and now_ns - self._gaps[0][0] > WINDOW_NS:
            self._gaps.popleft()
        return len(self._arrivals), max(0, sum(lost for _, lost in self._gaps))

    def rate_hz(self, now_ns: int) -> float | None:
        """Return the rate of the last seconds in Hz; None for events or without any frame."""
        received, _ = self.recent(now_ns)
        if not self.topic.rate_hz or not self.received:
            return None
        if received < 2:
            return 0.0
        period_ns = NS_PER_S / self.topic.rate_hz
        return received * NS_PER_S / (now_ns - self._arrivals[0] + period_ns)


class Streams:
    """Counters of all topics of one robot."""

    def __init__(self, topics: Iterable[Topic[Any]]) -> None:
        self._counters = {topic.path: StreamCounter(topic) for topic in topics}

    def take(self, arrival: ReceivedFrame) -> None:
        """Count a frame."""
        self._counters[arrival.path].take(arrival.frame, arrival.arrived_ns)

    def skip(self, role: Role | None = None) -> None:
        """Ignore the next gap of each topic, or of those that a restarted process publishes."""
        for counter in self._counters.values():
            if role in (None, counter.topic.publisher):
                counter.skip()

    def percent(self, now_ns: int) -> float | None:
        """Return the percentage of the robot's recent frames that arrived; None without any."""
        own = [one for one in self._counters.values() if one.topic.publisher is Role.ROBOT]
        if not any(one.received for one in own):
            return None
        counts = [one.recent(now_ns) for one in own]
        received, lost = (sum(column) for column in zip(*counts, strict=True))
        return 100.0 * received / (received + lost) if received else 0.0

    def rows(self, telemetry: Telemetry, now_ns: int) -> list[StreamRow]:
        """Return a line for each topic that is subscribed to."""
        return [
            self._row(counter, telemetry, now_ns)
            for counter in self._counters.values()
            if telemetry.is_followed(counter.topic)
        ]

    def _row(self, counter: StreamCounter, telemetry: Telemetry, now_ns: int) -> StreamRow:
        topic = counter.topic
        box = telemetry.boxes()[topic.path]
        newest = box.latest()
        age_ns = None if newest is None else now_ns - newest[1]
        received, lost = counter.recent(now_ns)
        return StreamRow(
            topic=topic,
            rate_hz=counter.rate_hz(now_ns),
            age_ns=age_ns,
            age=Age.GONE if age_ns is None else telemetry.age_of(topic, age_ns),
            received=counter.received,
            lost=counter.lost,
            lost_percent=100.0 * lost / (received + lost) if received + lost else 0.0,
            rejected=box.rejected,
            last_rejection=box.last_rejection,
        )
