"""Telemetry for asyncio: every message of a topic in a bounded queue that never blocks the bus."""

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, Generic, Protocol, Self, TypeVar

from protocol.bus.mailbox import Mailbox
from protocol.topics import Topic
from protocol.wire.message import Message

T = TypeVar("T")
M = TypeVar("M", bound=Message)
QUEUE: Final = 256
"""Items that wait by default: 12 s of a stream at 20 Hz."""


class Stream(Generic[T]):
    """An asynchronous iterator over what is offered to it, oldest first.

    At most `size` items wait; when more come, the oldest give way and `dropped` counts them. End it
    with `aclose`, or by leaving the context of the robot.
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
        """Add an item; may be called from any thread, and returns at once."""
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
        """End the stream; what waits may still be read."""
        self.close()

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._arrived.set()
            self._on_close()


class TopicSource(Protocol):
    """The part of a bus that topics are heard by."""

    def mailbox(
        self,
        topic: Topic[M],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
    ) -> Mailbox[M]: ...
    def forget(self, mailbox: Mailbox[Any]) -> None: ...


class TopicStreams:
    """The topics of one robot, each subscribed once, for as many streams as there are."""

    def __init__(self, bus: TopicSource, robot: str) -> None:
        self._bus = bus
        self._robot = robot
        self._boxes: dict[str, Mailbox[Any]] = {}
        self._streams: dict[str, frozenset[Stream[Any]]] = {}
        self._kept: set[str] = set()

    def keep(self, *topics: Topic[Any]) -> None:
        """Hear these until the end, whether there are streams of them or not."""
        for topic in topics:
            self._kept.add(topic.path)
            self._subscribe(topic)

    def latest(self, topic: Topic[M]) -> tuple[M, int] | None:
        """The newest message of a topic that is heard, and when it arrived (ns)."""
        box = self._boxes.get(topic.path)
        return None if box is None else box.latest()

    def stream(self, topic: Topic[M], size: int = QUEUE) -> Stream[M]:
        """All messages of a topic from now on."""
        found: Stream[M] = Stream(size)
        self.add(topic, found)
        found._on_close = lambda: self.remove(topic, found)
        return found

    def add(self, topic: Topic[M], stream: Stream[M]) -> None:
        """Offer every message of a topic to a stream."""
        path = topic.path
        self._streams[path] = self._streams.get(path, frozenset()) | {stream}
        self._subscribe(topic)

    def _subscribe(self, topic: Topic[Any]) -> None:
        path = topic.path
        if path not in self._boxes:
            self._boxes[path] = self._bus.mailbox(topic, self._robot, lambda _at: self._pass(path))

    def remove(self, topic: Topic[Any], stream: Stream[Any]) -> None:
        """End that; a topic without streams is unsubscribed."""
        path = topic.path
        left = self._streams[path] = self._streams.get(path, frozenset()) - {stream}
        if left or path in self._kept:
            return
        if (box := self._boxes.pop(path, None)) is not None:
            self._bus.forget(box)

    def close(self) -> None:
        for streams in list(self._streams.values()):
            for stream in streams:
                stream.close()

    def _pass(self, path: str) -> None:
        """In the bus's thread: hand the newest message on."""
        box = self._boxes.get(path)
        newest = None if box is None else box.latest()
        if newest is not None:
            for stream in self._streams.get(path, ()):
                stream.offer(newest[0])
