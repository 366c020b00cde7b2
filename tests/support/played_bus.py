"""Buses that a test plays: no sockets, no threads; mailboxes hold what the test puts in."""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from protocol.bus.bus import Bus, Presence
from protocol.bus.mailbox import Mailbox, Origin, Sample
from protocol.bus.network import Hub
from protocol.topics import ENCODING, Role, Service, Topic
from protocol.wire.codec import Encoder, decode
from protocol.wire.message import Message
from runtime.clock import ManualClock
from runtime.errors import NoAnswerError

M = TypeVar("M", bound=Message)
Handler = Callable[[str, bytes, int], None]


class PlayedPublisher:
    """Stores what was published, and passes it to `heard` if that is set."""

    def __init__(self) -> None:
        self.said: list[Message] = []
        self.heard: Callable[[Message], None] | None = None
        self._encoder = Encoder(1, 1)

    def frame(self, message: Message) -> bytes:
        return self._encoder.encode(message)

    def put_frame(self, frame: bytes) -> None:
        self.put(decode(frame).message)

    def put(self, message: Message) -> None:
        self.said.append(message)
        if self.heard is not None:
            self.heard(message)


class PlayedBus:
    """`say` publishes for other processes; `answers` has the reply of each service, by path."""

    zid = "ours"
    operator = "open/ours"
    holder = None

    def __init__(self, clock: ManualClock) -> None:
        self._clock = clock
        self.now_ns = clock.now_ns
        self._boxes: list[tuple[str, Mailbox[Any]]] = []
        self._handlers: list[tuple[str, str, Handler]] = []
        self._handler_of: dict[Mailbox[Any], tuple[str, str, Handler]] = {}
        self._encoders: dict[tuple[str, str], Encoder] = {}
        self._watchers: list[Callable[[Presence, bool], None]] = []
        self.there: set[Presence] = set()
        self.publishers: dict[tuple[str, str], PlayedPublisher] = {}
        self.answers: dict[str, Callable[[Message | None], Message | bytes]] = {}
        self.asked: list[tuple[str, str, Message | None]] = []
        self.linked_by = Hub.PEER
        self.shut = ""

    # The others.

    def say(self, topic: Topic[Any], message: Message, robot: str = "r1", age_ns: int = 0) -> None:
        """`age_ns`: time from publication to fetch."""
        encoder = self._encoders.setdefault((robot, topic.path), Encoder(1, 1))
        self.say_frame(topic, encoder.encode(message), robot, age_ns)

    def say_frame(
        self, topic: Topic[Any], frame: bytes, robot: str = "r1", age_ns: int = 0
    ) -> None:
        now_ns = self._clock.now_ns() - age_ns
        for name, path, handler in self._handlers:
            if (name, path) == (robot, topic.path):
                handler(topic.key(robot), frame, now_ns)
        for name, box in self._boxes:
            if (name, box.topic.path) == (robot, topic.path):
                box.store(Sample(ENCODING, frame), now_ns)

    def lose(self, topic: Topic[Any], message: Message, robot: str = "r1") -> None:
        """Send a frame that never arrives."""
        self._encoders.setdefault((robot, topic.path), Encoder(1, 1)).encode(message)

    def come(self, role: Role, robot: str = "r1", zid: str = "") -> None:
        who = Presence(robot, role.value, zid or f"{role.value}-of-{robot}")
        self.there.add(who)
        for tell in self._watchers:
            tell(who, True)

    def go(self, role: Role, robot: str = "r1") -> None:
        for who in [one for one in self.there if (one.robot, one.role) == (robot, role.value)]:
            self.there.remove(who)
            for tell in self._watchers:
                tell(who, False)

    # What a station asks of a bus.

    def mailbox(
        self,
        topic: Topic[M],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
        *,
        check: Callable[[M], str] | None = None,
        take: Handler | None = None,
    ) -> Mailbox[M]:
        box = Mailbox(topic, notify, check=check)
        self._boxes.append((robot or "r1", box))
        if take is not None:
            entry = (robot or "r1", topic.path, take)
            self._handlers.append(entry)
            self._handler_of[box] = entry
        return box

    def unsubscribe(self, mailbox: Mailbox[Any]) -> None:
        self._boxes = [(robot, box) for robot, box in self._boxes if box is not mailbox]
        entry = self._handler_of.pop(mailbox, None)
        if entry is not None:
            self._handlers.remove(entry)

    def stream(self, topic: Topic[Any], handler: Handler, robot: str | None = None) -> None:
        self._handlers.append((robot or "r1", topic.path, handler))

    def present(self) -> Iterable[Presence]:
        return sorted(self.there)

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        self.asked.append((robot or "r1", service.path, message))
        answer = self.answers.get(service.path)
        if answer is None:
            raise NoAnswerError(f"{service.path}: no process serves it")
        return answer(message)

    def publisher(self, topic: Topic[M], robot: str | None = None) -> PlayedPublisher:
        return self.publishers.setdefault((robot or "r1", topic.path), PlayedPublisher())

    def await_matched(self, publishers: list[Any], timeout_s: float = 1.0) -> list[Any]:
        return []

    def announce(self, robot: str | None = None) -> None:
        self.come(Role.GROUND, robot or "r1", self.zid)

    def watch(self, handler: Callable[[Presence, bool], None]) -> None:
        self._watchers.append(handler)
        for who in sorted(self.there):
            handler(who, True)

    def hub(self) -> Hub:
        return self.linked_by

    def kept_out(self) -> str:
        return self.shut


class Box(Mailbox[Any]):
    """Holds what the test puts in."""

    newest: tuple[Any, int] | None = None
    sender = "open/0a"
    delay_ns = 0
    """How long before its arrival a frame of an operator was sent."""

    def latest(self) -> tuple[Any, int] | None:
        return self.newest

    def received(self) -> list[tuple[Any, Origin]]:
        if self.newest is None:
            return []
        message, arrived_ns = self.newest
        return [(message, Origin(self.sender, arrived_ns - self.delay_ns, arrived_ns))]


class Wireless(Bus):
    """One mailbox for each topic; nothing is opened."""

    def __init__(self) -> None:
        self.boxes: dict[str, Box] = {}

    def mailbox(self, topic: Topic[Any], *_: Any, **__: Any) -> Box:
        return self.boxes.setdefault(topic.path, Box(topic))


class Air:
    """One mailbox for each topic."""

    def __init__(self) -> None:
        self.boxes: dict[str, Mailbox[Any]] = {}
        self._encoder = Encoder(1, 1)

    def mailbox(
        self,
        topic: Topic[Any],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
        *,
        take: Callable[[str, bytes, int], None] | None = None,
    ) -> Mailbox[Any]:
        return self.boxes.setdefault(topic.path, Mailbox(topic, notify))

    def put(self, topic: Topic[Any], message: Message, at_ns: int) -> None:
        self.boxes[topic.path].store(Sample(ENCODING, self._encoder.encode(message)), at_ns)
