"""Telemetry for asyncio: every message of a topic in a bounded queue that never blocks the bus."""

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, Generic, Protocol, Self, TypeVar

from ground.client.telemetry import MailboxSource
from protocol.bus.mailbox import Mailbox
from protocol.topics import Topic
from protocol.wire.message import Message
from runtime.errors import LocalError

CLOSED: Final = (
    "this client is closed: use the robot inside of `async with sidestep.connect() as robot:`"
)
T = TypeVar("T")
M = TypeVar("M", bound=Message)
QUEUE: Final = 256
"""Default length of a queue: 12 s of a stream at 20 Hz."""


class ClosedError(LocalError, RuntimeError):
    """The context of the robot has ended."""


class Stream(Generic[T]):
    """An asynchronous iterator over the items offered to it, oldest first.

    At most `size` items wait. When more arrive, the oldest are dropped and counted in `dropped`.
    End the stream with `aclose`, or by leaving the context of the robot.
    """

    def __init__(self, size: int = QUEUE, on_close: Callable[[], None] = lambda: None) -> None:
        self.dropped = 0
        self._loop = asyncio.get_running_loop()
        self._arrived = asyncio.Event()
        self._waiting: deque[T] = deque(maxlen=size)
        self._announced = False
        self._closed = False
        self._on_close = on_close

    def offer(self, item: T) -> None:
        """Add an item, from any thread, without blocking."""
        if len(self._waiting) == self._waiting.maxlen:
            self.dropped += 1
        self._waiting.append(item)
        if not self._announced:
            self._announced = True
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._arrived.set)

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> T:
        while True:
            with suppress(IndexError):
                return self._waiting.popleft()
            if self._closed:
                raise StopAsyncIteration
            self._arrived.clear()
            self._announced = False
            if not self._waiting and not self._closed:
                await self._arrived.wait()

    async def aclose(self) -> None:
        """End the stream; items that wait can still be read."""
        self.close()

    def close(self) -> None:
        """End the stream, without awaiting."""
        if not self._closed:
            self._closed = True
            self._arrived.set()
            self._on_close()


class TopicSource(MailboxSource, Protocol):
    """The part of a bus that subscribes to topics."""

    def unsubscribe(self, mailbox: Mailbox[Any]) -> None:
        """Unsubscribe a mailbox."""


class TopicStreams:
    """The topics of one robot, each subscribed once, for any number of streams."""

    def __init__(self, bus: TopicSource, robot: str) -> None:
        self._bus = bus
        self._robot = robot
        self._boxes: dict[str, Mailbox[Any]] = {}
        self._streams: dict[str, frozenset[Stream[Any]]] = {}
        self._kept: set[str] = set()
        self._is_closed = False

    def keep(self, *topics: Topic[Any]) -> None:
        """Subscribe to topics until `close`, even without streams."""
        for topic in topics:
            self._kept.add(topic.path)
            self._subscribe(topic)

    def latest(self, topic: Topic[M]) -> tuple[M, int] | None:
        """Return the newest message of a subscribed topic and its arrival time (ns)."""
        box = self._boxes.get(topic.path)
        return None if box is None else box.latest()

    def stream(self, topic: Topic[M], size: int = QUEUE) -> Stream[M]:
        """Return a stream of all messages of a topic from now on."""
        stream: Stream[M] = Stream(size)
        self.add(topic, stream)
        stream._on_close = lambda: self.remove(topic, stream)
        return stream

    def add(self, topic: Topic[M], stream: Stream[M]) -> None:
        """Offer every message of a topic to a stream; ClosedError after `close`."""
        if self._is_closed:
            raise ClosedError(CLOSED)
        path = topic.path
        self._streams[path] = self._streams.get(path, frozenset()) | {stream}
        self._subscribe(topic)

    def _subscribe(self, topic: Topic[Any]) -> None:
        path = topic.path
        if path not in self._boxes:
            self._boxes[path] = self._bus.mailbox(topic, self._robot, lambda _at: self._pass(path))

    def remove(self, topic: Topic[Any], stream: Stream[Any]) -> None:
        """Stop offering messages to a stream; unsubscribe a topic without streams."""
        path = topic.path
        remaining = self._streams[path] = self._streams.get(path, frozenset()) - {stream}
        if remaining or path in self._kept:
            return
        if (box := self._boxes.pop(path, None)) is not None:
            self._bus.unsubscribe(box)

    def close(self) -> None:
        """End all streams."""
        self._is_closed = True
        for streams in list(self._streams.values()):
            for stream in streams:
                stream.close()

    def _pass(self, path: str) -> None:
        """Hand on the newest message, in the bus's thread."""
        box = self._boxes.get(path)
        newest = None if box is None else box.latest()
        if newest is not None:
            for stream in self._streams.get(path, ()):
                stream.offer(newest[0])
