"""Publisher of one topic: one key, one sender, one sequence counter."""

import threading
from collections.abc import Callable, Iterable
from typing import Any, Final, Generic, TypeVar

import zenoh

from protocol.bus.lasting_session import Declared, LastingSession
from protocol.bus.late_join import LIVE, caching_publisher
from protocol.bus.robot_clock import time_bytes
from protocol.topics import ENCODING, Priority, Topic
from protocol.wire.codec import Encoder
from protocol.wire.message import Message
from runtime.errors import LocalError
from runtime.load import Patience
from runtime.units import NS_PER_S

M = TypeVar("M", bound=Message)

PRIORITIES: Final = {
    Priority.REAL_TIME: zenoh.Priority.REAL_TIME,
    Priority.DATA_HIGH: zenoh.Priority.DATA_HIGH,
    Priority.DATA: zenoh.Priority.DATA,
    Priority.DATA_LOW: zenoh.Priority.DATA_LOW,
}
POLL_S: Final = 0.001


class Publisher(Generic[M]):
    """Publish messages of one topic on its key.

    `time_ns` returns the robot's time, None while it is unknown: samples of an operator carry this
    sending time. Samples of a topic with a history also carry their UTC time.
    """

    def __init__(
        self,
        session: LastingSession,
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
        # Express loses samples under load; BLOCK can block a loop for seconds. Neither is used.
        service: dict[str, Any] = {
            "encoding": ENCODING,
            "priority": PRIORITIES[topic.priority],
            "express": False,
            "reliability": zenoh.Reliability.RELIABLE,
        }
        plain = session.declare(
            lambda one: one.declare_publisher(key, congestion_control=LIVE, **service)
        )
        self._matching = plain  # an advanced publisher has no matching status
        self._publisher: Declared[Any] = plain
        if topic.history:
            self._publisher = session.declare(
                lambda one: caching_publisher(one, key, topic.history, **service)
            )

    def put(self, message: M) -> bytes:
        """Send a message and return its frame; LocalError if it fits neither topic nor wire."""
        frame = self.frame(message)
        self.put_frame(frame)
        return frame

    def frame(self, message: M) -> bytes:
        """Return the next frame of this key for `put_frame`; LocalError as for `put`."""
        if type(message) not in self.topic.messages:
            raise LocalError(f"{type(message).__name__} does not belong on {self.key}")
        return self._encoder.encode(message)

    def put_frame(self, frame: bytes) -> None:
        """Send a frame unchanged: prepared by `frame`, replayed, or malformed on purpose."""
        publisher = self._publisher.now
        try:
            stamp = self._session.now.new_timestamp() if self.topic.history else None
            publisher.put(frame, attachment=self._sent(), timestamp=stamp)
        except zenoh.ZError:
            if publisher is self._publisher.now:
                raise
            self.put_frame(frame)  # a fresh session has replaced the one before

    def _sent(self) -> bytes | None:
        time_ns = None if self._time_ns is None else self._time_ns()
        return None if time_ns is None else time_bytes(time_ns)

    @property
    def ready(self) -> bool:
        """Return whether there is a subscriber and, for an operator, the robot's time is known."""
        return self.matched and (self._time_ns is None or self._time_ns() is not None)

    @property
    def matched(self) -> bool:
        """Return whether there is a subscriber.

        Samples put before are lost unless the topic has a history.
        """
        # Zenoh's stub declares bool, but the value is an object, which is always true.
        status: Any = self._matching.now.matching_status
        return bool(status.matching)


def await_ready(publishers: Iterable[Publisher[Any]], timeout_s: float) -> list[str]:
    """Wait until each publisher has a subscriber and, for an operator, its robot's time.

    Return the keys of those that were not ready in time, which counts less on a busy machine.
    """
    waiting = [publisher for publisher in publishers if not publisher.ready]
    patience = Patience(round(timeout_s * NS_PER_S))
    pause = threading.Event()
    while waiting and patience.left_ns():
        pause.wait(POLL_S)
        waiting = [publisher for publisher in waiting if not publisher.ready]
    return [publisher.key for publisher in waiting]
