"""Buses that a test plays: no sockets, no threads; mailboxes hold what the test puts in."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

from protocol.bus.bus import Bus, Presence
from protocol.bus.mailbox import Mailbox, Sample
from protocol.bus.network import Hub
from protocol.bus.services import ServiceRequest
from protocol.topics import ENCODING, Role, Service, Topic
from protocol.wire.codec import Encoder, decode
from protocol.wire.message import Message
from runtime.clock import ManualClock
from runtime.errors import NoAnswerError

M = TypeVar("M", bound=Message)
Handler = Callable[[str, bytes, int], None]
Take = Callable[[ServiceRequest], object]


class PlayedPublisher:
    """Stores what was published, and passes it to `heard` if that is set."""

    ready = matched = True

    def __init__(self, path: str, sent: list[tuple[str, Message]]) -> None:
        self.key = path
        self.said: list[Message] = []
        self.heard: Callable[[Message], None] | None = None
        self._sent = sent
        self._encoder = Encoder(1, 1)

    def frame(self, message: Message) -> bytes:
        return self._encoder.encode(message)

    def put_frame(self, frame: bytes) -> None:
        self.put(decode(frame).message)

    def put(self, message: Message) -> None:
        self.said.append(message)
        self._sent.append((self.key, message))
        if self.heard is not None:
            self.heard(message)


class PlayedQuery(NamedTuple):
    """A query of a played bus."""

    service: Service
    message: Message | None
    timeout_s: float
    patience_s: float
    robot: str


class PlayedBus(Bus):
    """`say` publishes for other processes; `answers` has the reply of each service, by path.

    `has_history`: a mailbox begins with the newest message that was said before.
    """

    zid = "ours"
    operator = "open/ours"
    holder = None
    robot = "r1"
    role: Role | None = Role.ROBOT
    rejected: Mapping[str, int] = MappingProxyType({})  # type: ignore[assignment]
    has_history = False
    has_subscriber = True

    def __init__(self, clock: ManualClock) -> None:
        self._clock = clock
        self.requester: Any = self
        self._now_ns = clock.now_ns
        self._boxes: list[tuple[str, Mailbox[Any]]] = []
        self._handlers: list[tuple[str, str, Handler]] = []
        self._handler_of: dict[Mailbox[Any], tuple[str, str, Handler]] = {}
        self._encoders: dict[tuple[str, str], Encoder] = {}
        self._newest: dict[tuple[str, str], tuple[Sample, int]] = {}
        self._watchers: list[Callable[[Presence, bool], None]] = []
        self.subscribed: list[tuple[str, str]] = []
        """Robot and path of each subscription there ever was."""
        self.there: set[Presence] = set()
        self.publishers: dict[tuple[str, str], PlayedPublisher] = {}
        self.sent: list[tuple[str, Message]] = []
        self.answers: dict[str, Callable[[Message | None], Message | bytes]] = {}
        self.asked: list[tuple[str, str, Message | None]] = []
        self.services: dict[str, Take] = {}
        self.has_clock = False
        self.kept_serving = self.serving_ns = 0
        self.linked_by = Hub.PEER
        self.shut = ""

    # The others.

    def say(
        self,
        topic: Topic[Any],
        message: Message,
        robot: str = "r1",
        *,
        at_ns: int | None = None,
        sender: str = "",
        late_ns: int | None = 0,
    ) -> None:
        """Deliver a message, by default now.

        The frame of a sender is this late; None: without a stamp.
        """
        encoder = self._encoders.setdefault((robot, topic.path), Encoder(1, 1))
        self.say_frame(topic, encoder.encode(message), robot, at_ns, sender, late_ns)

    def say_frame(
        self,
        topic: Topic[Any],
        frame: bytes,
        robot: str = "r1",
        at_ns: int | None = None,
        sender: str = "",
        late_ns: int | None = 0,
    ) -> None:
        now_ns = self._clock.now_ns() if at_ns is None else at_ns
        for name, path, handler in self._handlers:
            if (name, path) == (robot, topic.path):
                handler(topic.key(robot), frame, now_ns)
        sent_ns = now_ns - late_ns if sender and late_ns is not None else None
        sample = Sample(ENCODING, frame, sender, sent_ns)
        self._newest[robot, topic.path] = sample, now_ns
        for name, box in self._boxes:
            if (name, box.topic.path) == (robot, topic.path):
                box.store(sample, now_ns)

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

    # What a process asks of a bus.

    def mailbox(
        self,
        topic: Topic[M],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
        accept: Callable[[str], bool] | None = None,
        *,
        forward: bool = False,
        check: Callable[[M], str] | None = None,
        take: Handler | None = None,
    ) -> Mailbox[M]:
        at = robot or self.robot, topic.path
        box = Mailbox(topic, notify, accept, forward=forward, check=check)
        self.subscribed.append(at)
        self._boxes.append((at[0], box))
        if take is not None:
            self._handlers.append((*at, take))
            self._handler_of[box] = self._handlers[-1]
        if self.has_history and at in self._newest:
            box.store(*self._newest[at])
        return box

    def unsubscribe(self, mailbox: Mailbox[Any]) -> None:
        self._boxes = [(robot, box) for robot, box in self._boxes if box is not mailbox]
        entry = self._handler_of.pop(mailbox, None)
        if entry is not None:
            self._handlers.remove(entry)

    def stream(self, topic: Topic[Any], handler: Handler, robot: str | None = None) -> None:
        self.subscribed.append((robot or self.robot, topic.path))
        self._handlers.append((robot or self.robot, topic.path, handler))

    def present(self) -> list[Presence]:
        return sorted(self.there)

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        self.asked.append((robot or self.robot, service.path, message))
        answer = self.answers.get(service.path)
        if answer is None:
            raise NoAnswerError(f"{service.path}: no process serves it")
        return answer(message)

    def steps(
        self, service: Service, message: Message | None, timeout_s: float, robot: str
    ) -> Iterator["PlayedQuery"]:
        return (yield PlayedQuery(service, message, timeout_s, timeout_s, robot))

    def send(self, query: "PlayedQuery", done: Callable[[object], object]) -> None:
        """Answer at once."""
        try:
            answer: object = self.ask(
                query.service, query.message, query.timeout_s, robot=query.robot
            )
        except NoAnswerError as error:
            answer = error
        done(answer)

    def publisher(self, topic: Topic[Any], robot: str | None = None) -> Any:
        publisher = PlayedPublisher(topic.path, self.sent)
        return self.publishers.setdefault((robot or self.robot, topic.path), publisher)

    def await_matched(self, publishers: Iterable[Any], timeout_s: float = 1.0) -> list[str]:
        return [] if self.has_subscriber else ["nobody"]

    def announce(self, robot: str | None = None) -> None:
        self.come(Role.GROUND, robot or self.robot, self.zid)

    def watch(self, handler: Callable[[Presence, bool], None]) -> None:
        self._watchers.append(handler)
        for who in sorted(self.there):
            handler(who, True)

    def hub(self) -> Hub:
        return self.linked_by

    def kept_out(self) -> str:
        return self.shut

    def lost(self) -> str:
        return ""

    def serve(
        self,
        service: Service,
        handler: Take,
        robot: str | None = None,
    ) -> None:
        self.services[service.path] = handler

    def serve_stop(self, pressed: Callable[[str, bytes], None], handler: Take) -> None:
        self.press, self.take_stop = pressed, handler

    def serve_clock(self) -> None:
        self.has_clock = True

    def keep_serving(self) -> None:
        self.kept_serving += 1
        self._clock.advance(self.serving_ns)
