"""What the robot says, each stream with its age: an old value is never shown as if it were live."""

from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from typing import Any, Final, NamedTuple, Protocol, TypeVar

from protocol.bus.mailbox import Mailbox
from protocol.topics import (
    CYCLE,
    DECISION,
    HEARTBEAT,
    ODOMETRY,
    STATUS,
    Topic,
)
from protocol.wire.message import Message
from runtime.units import NS_PER_S

M = TypeVar("M", bound=Message)
Take = Callable[[str, bytes, int], None]
"""Key, frame, and when it came or was told, in ns; called in the bus's thread."""

DIM_PERIODS: Final = 2.0
GONE_PERIODS: Final = 5.0
LOOKED_AT: Final[tuple[Topic[Any], ...]] = (HEARTBEAT, STATUS, ODOMETRY, DECISION, CYCLE)


class Age(Enum):
    """How far a value may be trusted to be the present one."""

    LIVE = "live"
    DIM = "dim"
    GONE = "gone"


class Listens(Protocol):
    """What telemetry needs of the bus."""

    def mailbox(
        self,
        topic: Topic[M],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
        *,
        take: Take | None = None,
    ) -> Mailbox[M]: ...


class Seen(NamedTuple):
    """The newest message of a topic; `age_ns` None: nothing has ever come."""

    message: Message | None
    age_ns: int | None
    age: Age


class Telemetry:
    """Mailboxes of one robot's topics.

    `taker` returns who else gets every frame of a topic, by its path; None: nobody.
    """

    def __init__(
        self,
        bus: Listens,
        robot: str,
        topics: Iterable[Topic[Any]] = LOOKED_AT,
        notify: Callable[[int], None] | None = None,
        taker: Callable[[str], Take | None] = lambda _path: None,
    ) -> None:
        self._boxes: dict[str, Mailbox[Any]] = {
            topic.path: bus.mailbox(topic, robot, notify, take=taker(topic.path))
            for topic in topics
        }

    def latest(self, topic: Topic[M]) -> tuple[M, int] | None:
        """The newest message, however old, and when it arrived."""
        found: tuple[M, int] | None = self._boxes[topic.path].latest()
        return found

    def fresh(self, topic: Topic[M], now_ns: int) -> M | None:
        """The newest message, None when it is stale."""
        found: M | None = self._boxes[topic.path].fresh(now_ns)
        return found

    def live(self, topic: Topic[M], now_ns: int) -> M | None:
        """The newest message, None when it is too old to be shown at all."""
        newest = self.latest(topic)
        if newest is None or age_of(topic, now_ns - newest[1]) is Age.GONE:
            return None
        return newest[0]

    def seen(self, topic: Topic[Any], now_ns: int) -> Seen:
        newest = self.latest(topic)
        if newest is None:
            return Seen(None, None, Age.GONE)
        age_ns = now_ns - newest[1]
        return Seen(newest[0], age_ns, age_of(topic, age_ns))

    def boxes(self) -> Mapping[str, Mailbox[Any]]:
        return self._boxes


def age_of(topic: Topic[Any], age_ns: int) -> Age:
    """An event stays; a stream fades after a few of its periods."""
    if not topic.rate_hz:
        return Age.LIVE
    periods = age_ns * topic.rate_hz / NS_PER_S
    if periods > GONE_PERIODS:
        return Age.GONE
    return Age.DIM if periods > DIM_PERIODS else Age.LIVE
