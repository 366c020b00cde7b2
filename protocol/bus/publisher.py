"""One key, one sender, one sequence counter."""

import threading
import time
from collections.abc import Callable, Iterable
from typing import Any, Final, Generic, TypeVar

import zenoh

from protocol.bus.late_join import TOLD, keeping
from protocol.bus.robot_clock import time_bytes
from protocol.topics import ENCODING, Priority, Topic
from protocol.wire.codec import Encoder
from protocol.wire.message import Message
from runtime.errors import LocalError

M = TypeVar("M", bound=Message)

PRIORITIES: Final = {
    Priority.REAL_TIME: zenoh.Priority.REAL_TIME,
    Priority.DATA_HIGH: zenoh.Priority.DATA_HIGH,
    Priority.DATA: zenoh.Priority.DATA,
    Priority.DATA_LOW: zenoh.Priority.DATA_LOW,
}
POLL_S: Final = 0.001


class Publisher(Generic[M]):
    """Puts messages of one topic on its key.

    `time_ns` returns the robot's time, None while it is unknown: what an operator sends carries
    when that was. Messages of a topic with a history carry when they were put, too.
    """

    def __init__(
        self,
        session: zenoh.Session,
        topic: Topic[M],
        key: str,
        encoder: Encoder,
        time_ns: Callable[[], int | None] | None = None,
    ) -> None:
        self.topic = topic
        self.key = key
        self._encoder = encoder
        self._time_ns = time_ns
        self._session = session
        # Express loses samples under load, BLOCK can hold a loop for seconds: neither is used.
        service: dict[str, Any] = {
            "encoding": ENCODING,
            "priority": PRIORITIES[topic.priority],
            "express": False,
            "reliability": zenoh.Reliability.RELIABLE,
        }
        plain = session.declare_publisher(key, congestion_control=TOLD, **service)
        self._matching = plain  # an advanced publisher cannot be asked who listens
        self._publisher: Any = plain
        if topic.history:
            self._publisher = keeping(session, key, topic.history, **service)

    def put(self, message: M) -> bytes:
        """Send and return the frame; LocalError when it does not belong here or does not fit."""
        frame = self.frame(message)
        self.put_frame(frame)
        return frame

    def frame(self, message: M) -> bytes:
        """The next frame of this key, to be sent by `put_frame`; LocalError as for `put`."""
        if type(message) not in self.topic.messages:
            raise LocalError(f"{type(message).__name__} does not belong on {self.key}")
        return self._encoder.encode(message)

    def put_frame(self, frame: bytes) -> None:
        """Send bytes as they are: made before, replayed, or broken on purpose."""
        stamp = self._session.new_timestamp() if self.topic.history else None
        self._publisher.put(frame, attachment=self._sent(), timestamp=stamp)

    def _sent(self) -> bytes | None:
        time_ns = None if self._time_ns is None else self._time_ns()
        return None if time_ns is None else time_bytes(time_ns)

    @property
    def ready(self) -> bool:
        """Return whether a reader is there and, for an operator, the robot's time is known."""
        return self.matched and (self._time_ns is None or self._time_ns() is not None)

    @property
    def matched(self) -> bool:
        """Does anybody subscribe? What is put before is lost, unless the topic has a history."""
        # Zenoh's stub says bool, but it is an object, and one that is always true.
        status: Any = self._matching.matching_status
        return bool(status.matching)


def await_ready(publishers: Iterable[Publisher[Any]], timeout_s: float) -> list[str]:
    """Wait until each has a subscriber, and an operator's knows its robot's time.

    Return the keys of those that were not ready in time.
    """
    waiting = [publisher for publisher in publishers if not publisher.ready]
    deadline_s = time.monotonic() + timeout_s
    pause = threading.Event()
    while waiting and time.monotonic() < deadline_s:
        pause.wait(POLL_S)
        waiting = [publisher for publisher in waiting if not publisher.ready]
    return [publisher.key for publisher in waiting]
