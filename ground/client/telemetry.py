"""Telemetry of a robot, each stream with its age, so that an old value is never shown as live."""

from collections.abc import Callable, Collection, Iterable, Mapping
from enum import Enum
from typing import Any, Final, NamedTuple, Protocol, TypeVar, cast

from protocol.bus.mailbox import Mailbox
from protocol.topics import CYCLE, DECISION, HEARTBEAT, ODOMETRY, STATUS, SUMMARIES, Topic
from protocol.wire.message import Message
from runtime.units import NS_PER_S

M = TypeVar("M", bound=Message)
FrameHandler = Callable[[str, bytes, int], None]
"""Receives a key, a frame and its time in ns; called in the bus's thread."""

DIM_PERIODS: Final = 2.0
GONE_PERIODS: Final = 5.0
SUMMARY_TOPICS: Final[tuple[Topic[Any], ...]] = (HEARTBEAT, STATUS, ODOMETRY, DECISION, CYCLE)


class Age(Enum):
    """The freshness of a value: live, fading (dim) or gone."""

    LIVE = "live"
    DIM = "dim"
    GONE = "gone"


class MailboxSource(Protocol):
    """The part of a bus that keeps the newest message of a topic."""

    def mailbox(
        self,
        topic: Topic[M],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
        *,
        take: FrameHandler | None = None,
    ) -> Mailbox[M]:
        """Subscribe to a topic; call `notify` at each arrival and `take` with each frame."""


class Subscriptions(MailboxSource, Protocol):
    """The part of a bus that can also end what it keeps."""

    def unsubscribe(self, mailbox: Mailbox[Any]) -> None:
        """End the subscription of a mailbox."""


class AgedMessage(NamedTuple):
    """The newest message of a topic; `age_ns` is None if nothing has ever arrived."""

    message: Message | None
    age_ns: int | None
    age: Age


class Telemetry:
    """Mailboxes of one robot's topics.

    `taker` returns the handler that also gets every frame of a topic, by its path, or None.
    `pace` is simulated over wall time: ages are judged in the robot's time, which may be slower.
    A stream that is not subscribed to is known by its summary, by whose rate its age is judged.
    """

    def __init__(
        self,
        bus: MailboxSource,
        robot: str,
        topics: Iterable[Topic[Any]] = SUMMARY_TOPICS,
        notify: Callable[[int], None] | None = None,
        taker: Callable[[str], FrameHandler | None] = lambda _path: None,
    ) -> None:
        self.pace = 1.0
        self._robot, self._notify, self._taker = robot, notify, taker
        self._followed: dict[str, Mailbox[Any]] = {}
        self._boxes: dict[str, Mailbox[Any]] = {}
        self._subscribe(bus, topics)

    def follow(self, bus: Subscriptions, topics: Collection[Topic[Any]]) -> None:
        """Subscribe to these topics alone; the newest messages of the others are kept."""
        wanted = {topic.path for topic in topics}
        for path in self._followed.keys() - wanted:
            bus.unsubscribe(self._followed.pop(path))
        self._subscribe(bus, (topic for topic in topics if topic.path not in self._followed))

    def _subscribe(self, bus: MailboxSource, topics: Iterable[Topic[Any]]) -> None:
        for topic in topics:
            path = topic.path
            box = bus.mailbox(topic, self._robot, self._notify, take=self._taker(path))
            self._followed[path] = self._boxes[path] = box

    def is_followed(self, topic: Topic[Any]) -> bool:
        """Return whether a topic is subscribed to."""
        return topic.path in self._followed

    def latest(self, topic: Topic[M]) -> tuple[M, int] | None:
        """Return the newest message, however old, and its arrival time in ns."""
        return self._newest(topic)[1]

    def _newest(self, topic: Topic[M]) -> tuple[Topic[M], tuple[M, int] | None]:
        """Return the newest message, and the topic by whose rate its age is judged."""
        path = topic.path
        box = self._boxes.get(path)
        own = None if box is None else box.latest()
        summary = SUMMARIES.get(path)
        if summary is None or (summary_box := self._boxes.get(summary.path)) is None:
            return topic, own
        repeated = summary_box.latest()
        if own is None or (repeated is not None and repeated[1] > own[1]):
            return summary, repeated
        return (topic if path in self._followed else summary), own

    def fresh(self, topic: Topic[M], now_ns: int) -> M | None:
        """Return the newest message; None if it is stale."""
        judged, newest = self._newest(topic)
        if newest is None:
            return None
        limit_ns = judged.stale_after_ns
        return None if limit_ns and now_ns - newest[1] > limit_ns else newest[0]

    def live(self, topic: Topic[M], now_ns: int) -> M | None:
        """Return the newest message; None if it is too old to be shown."""
        seen = self.seen(topic, now_ns)
        return None if seen.age is Age.GONE else cast(M, seen.message)

    def seen(self, topic: Topic[Any], now_ns: int) -> AgedMessage:
        """Return the newest message with its age."""
        judged, newest = self._newest(topic)
        if newest is None:
            return AgedMessage(None, None, Age.GONE)
        age_ns = now_ns - newest[1]
        return AgedMessage(newest[0], age_ns, self._age_by(topic, judged, age_ns))

    def age_of(self, topic: Topic[Any], age_ns: int) -> Age:
        """Classify an age; a heartbeat and a summary keep their rate in wall time."""
        return self._age_by(topic, self._newest(topic)[0], age_ns)

    def _age_by(self, topic: Topic[Any], judged: Topic[Any], age_ns: int) -> Age:
        in_wall_time = topic is HEARTBEAT or judged is not topic
        return age_of(judged, age_ns if in_wall_time else round(age_ns * self.pace))

    def boxes(self) -> Mapping[str, Mailbox[Any]]:
        """Return the mailboxes by the path of their topics."""
        return self._boxes


def age_of(topic: Topic[Any], age_ns: int) -> Age:
    """Classify an age: an event never fades, a stream does after a few of its periods."""
    if not topic.rate_hz:
        return Age.LIVE
    periods = age_ns * topic.rate_hz / NS_PER_S
    if periods > GONE_PERIODS:
        return Age.GONE
    return Age.DIM if periods > DIM_PERIODS else Age.LIVE
