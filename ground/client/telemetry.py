"""Telemetry of a robot, each stream with its age, so that an old value is never shown as live."""

from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from typing import Any, Final, NamedTuple, Protocol, TypeVar

from protocol.bus.mailbox import Mailbox
from protocol.topics import CYCLE, DECISION, HEARTBEAT, ODOMETRY, STATUS, Topic
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


class AgedMessage(NamedTuple):
    """The newest message of a topic; `age_ns` is None if nothing has ever arrived."""

    message: Message | None
    age_ns: int | None
    age: Age


class Telemetry:
    """Mailboxes of one robot's topics.

    `taker` returns the handler that also gets every frame of a topic, by its path, or None.
    `pace` is simulated over wall time: ages are judged in the robot's time, which may be slower.
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
        self._boxes: dict[str, Mailbox[Any]] = {
            topic.path: bus.mailbox(topic, robot, notify, take=taker(topic.path))
            for topic in topics
        }

    def latest(self, topic: Topic[M]) -> tuple[M, int] | None:
        """Return the newest message, however old, and its arrival time in ns."""
        found: tuple[M, int] | None = self._boxes[topic.path].latest()
        return found

    def fresh(self, topic: Topic[M], now_ns: int) -> M | None:
        """Return the newest message; None if it is stale."""
        found: M | None = self._boxes[topic.path].fresh(now_ns)
        return found

    def live(self, topic: Topic[M], now_ns: int) -> M | None:
        """Return the newest message; None if it is too old to be shown."""
        newest = self.latest(topic)
        if newest is None or self.age_of(topic, now_ns - newest[1]) is Age.GONE:
            return None
        return newest[0]

    def seen(self, topic: Topic[Any], now_ns: int) -> AgedMessage:
        """Return the newest message with its age."""
        newest = self.latest(topic)
        if newest is None:
            return AgedMessage(None, None, Age.GONE)
        age_ns = now_ns - newest[1]
        return AgedMessage(newest[0], age_ns, self.age_of(topic, age_ns))

    def age_of(self, topic: Topic[Any], age_ns: int) -> Age:
        """Classify an age; a heartbeat keeps its rate in wall time."""
        return age_of(topic, age_ns if topic is HEARTBEAT else round(age_ns * self.pace))

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
