"""What a process may do on the bus: publish, listen, serve, ask, and show that it is there.

Callbacks run in Zenoh's receive thread, where a call into Zenoh or a wait would stall everything
that arrives: they store or enqueue, no more.
"""

import threading
import time
from collections.abc import Callable, Iterable
from types import TracebackType
from typing import Any, Self, TypeVar

import zenoh
from zenoh.handlers import Callback

from protocol.bus.access import unanswered
from protocol.bus.answer import answer_in
from protocol.bus.callers import callers
from protocol.bus.certificate import holder
from protocol.bus.history import following, told_ns
from protocol.bus.locks import shut
from protocol.bus.presence import Presence, presence_in
from protocol.bus.publisher import Publisher
from protocol.bus.service import Asked, Desk, Handler, sender_in, taken
from protocol.bus.session import bound_endpoints, called, gone, open_session
from protocol.bus.trouble import Line
from protocol.codec import Encoder
from protocol.errors import LocalError, NoAnswer
from protocol.mailbox import Mailbox, Sample
from protocol.message import Message
from protocol.network import Hub, Network
from protocol.sender import sender_of
from protocol.topics import ENCODING, TOPICS, Role, Service, Topic, robot_name

Take = Callable[[str, bytes, int], None]
"""Key, frame, and when it came in ns; for an event fetched afterwards, when it was told."""

M = TypeVar("M", bound=Message)
POLL_S = 0.001


class Bus:
    """One session of one process. Always close it, best by `with`."""

    def __init__(
        self,
        network: Network,
        role: Role | None,
        robot: str,
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.network = network
        self.role = role
        self.robot = robot_name(robot)
        self._now_ns = now_ns
        self._mailboxes: dict[Mailbox[Any], Any] = {}  # with its subscriber
        self._declared: list[object] = []
        self._watched: frozenset[Presence] | None = None
        self._desk = Desk()
        self.line = Line(network.trouble, now_ns)
        self.holder = holder(network.tls, role, robot)
        self._session = open_session(network)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Drop what is unanswered, undeclare everything, leave."""
        self._desk.close()
        session: Any = self._session
        session.close()
        self.line.close()

    @property
    def zid(self) -> str:
        return str(self._session.zid())

    @property
    def operator(self) -> str | None:
        """Who this is to the robots, attached to all that it asks and puts; None: no operator."""
        return self.zid if self.role is Role.GROUND else None

    def locator(self) -> str:
        """The endpoint others can dial, with the real port where 0 was asked for."""
        bound = bound_endpoints(self._session)
        if not bound:
            raise LocalError("this bus listens nowhere")
        return bound[0]

    def key(self, path: str, robot: str | None = None) -> str:
        return f"{self.network.prefix}/{robot_name(robot or self.robot)}/{path}"

    def publisher(self, topic: Topic[M], robot: str | None = None) -> Publisher[M]:
        key = self.key(topic.path, robot)
        return Publisher(self._session, topic, key, self._encoder(robot), self.operator)

    def mailbox(
        self,
        topic: Topic[M],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
        accept: Callable[[str], bool] | None = None,
        *,
        forward: bool = False,
    ) -> Mailbox[M]:
        """The newest message of a topic; `notify` gets each arrival (ns), in the bus's thread.

        `accept` gets the sender of each, as `Mailbox` has it, in the bus's thread too.
        """
        mailbox = Mailbox(topic, notify, accept, forward=forward)
        now_ns = self._now_ns
        from_whom = accept is not None

        def store(sample: zenoh.Sample) -> None:
            arrived_ns = now_ns()
            sender = sender_in(sample.attachment) if from_whom else ""
            mailbox.store(Sample(str(sample.encoding), taken(sample.payload), sender), arrived_ns)

        self._mailboxes[mailbox] = self._subscriber(self.key(topic.path, robot), store)
        return mailbox

    def forget(self, mailbox: Mailbox[Any]) -> None:
        """Listen no more: for those who only wanted to know something once."""
        subscriber = self._mailboxes.pop(mailbox, None)
        if subscriber is not None:
            subscriber.undeclare()

    def stream(self, source: Topic[Any] | str, handler: Take, robot: str | None = None) -> None:
        """Every frame of a topic, or of a key expression such as `sidestep/**`.

        Of a topic with a history also what was told before, and while nothing came through.
        """
        now_ns = self._now_ns

        def forward(sample: zenoh.Sample) -> None:
            handler(str(sample.key_expr), sample.payload.to_bytes(), told_ns(sample, now_ns()))

        if isinstance(source, str):
            self._declared.append(self._subscriber(source, forward))
        else:
            key = self.key(source.path, robot)
            self._declared.append(self._subscriber(key, forward, source.history))

    def everything(self, handler: Take, robot: str | None = None) -> None:
        """Every frame of one robot, once each, with all that its topics' histories hold."""
        histories = [topic for topic in TOPICS if topic.history]
        apart = frozenset(self.key(topic.path, robot) for topic in histories)

        def rest(key: str, frame: bytes, arrived_ns: int) -> None:
            if key not in apart:
                handler(key, frame, arrived_ns)

        self.stream(self.key("**", robot), rest)
        for topic in histories:
            self.stream(topic, handler, robot)

    def serve(self, service: Service, handler: Handler, robot: str | None = None) -> None:
        """Answer a service: `handler` runs in the bus's service thread, the reply in any."""
        key = self.key(service.path, robot)
        encoder = self._encoder(robot)
        desk = self._desk
        desk.start()

        def take(query: zenoh.Query) -> None:
            desk.put(Asked(query, key, service, encoder), handler)

        callback = Callback(take, indirect=False)
        self._declared.append(self._session.declare_queryable(key, callback))

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        """The answer, a message or the bytes of a JSON text; NoAnswer says why there is none."""
        key = self.key(service.path, robot)
        frame = None if message is None else self._encoder(robot).encode(message)
        encoding = None if frame is None else ENCODING
        replies = self._session.get(
            key, payload=frame, encoding=encoding, timeout=timeout_s, attachment=self.operator
        )
        for reply in replies:
            if reply.ok is not None:
                return answer_in(reply.ok)
            raise NoAnswer(f"{key}: no answer within {timeout_s:g} s")
        raise NoAnswer(f"{key}: {unanswered(self.holder, robot or self.robot, service)}")

    def announce(self, robot: str | None = None) -> None:
        """Show that this process is there for a robot, until it closes or dies."""
        if self.role is None:
            raise LocalError("a process without a role cannot announce itself")
        key = self.key(f"alive/{self.role.value}/{self.zid}", robot)
        self._declared.append(self._session.liveliness().declare_token(key))

    def present(self, timeout_s: float = 1.0) -> list[Presence]:
        """Who has announced itself, on all robots of this prefix.

        A session that watches answers from what it has seen: Zenoh 1.10 leaves such a question
        unanswered for some time after each token that its own subscriber was told of.
        """
        if self._watched is not None:
            return sorted(self._watched)
        key = f"{self.network.prefix}/*/alive/*/*"
        replies = self._session.liveliness().get(key, timeout=timeout_s)
        return sorted({presence_in(str(r.ok.key_expr)) for r in replies if r.ok is not None})

    def hub(self) -> Hub:
        """Who links this session to the others; calls those it dialled when nobody does."""
        info = self._session.info
        if list(info.routers_zid()):
            return Hub.ROUTER
        if list(info.peers_zid()) or not self.network.connect:
            return Hub.PEER
        calls = {called(endpoint) for endpoint in self.network.connect}
        return next(hub for hub in (Hub.HANGS, Hub.ENDED, Hub.UNREACHABLE) if hub in calls)

    def kept_out(self) -> str:
        """Why those it dialled do not let it in; empty when that is not what is wrong.

        Takes up to two seconds for each of them that takes the call and says nothing.
        """
        why = shut(self.network)
        return "" if why is None else str(why)

    def lost(self) -> str:
        """Why nobody can be heard: the hub is gone, hangs or lets nobody in. Empty while linked."""
        hub = self.hub()
        shut_out = self.kept_out() if hub is Hub.HANGS else ""
        return shut_out or gone(hub, ", ".join(self.network.connect))

    def watch(self, handler: Callable[[Presence, bool], None]) -> None:
        """Who comes (True) and goes (False), those already there included; only enqueue."""
        self._watched = frozenset()

        def forward(sample: zenoh.Sample) -> None:
            came = sample.kind == zenoh.SampleKind.PUT
            who = presence_in(str(sample.key_expr))
            seen = self._watched or frozenset()
            self._watched = seen | {who} if came else seen - {who}
            handler(who, came)

        key = f"{self.network.prefix}/*/alive/*/*"
        callback = Callback(forward, indirect=False)
        watcher = self._session.liveliness().declare_subscriber(key, callback, history=True)
        self._declared.append(watcher)

    def on_caller(self, handler: Callable[[str, str | None, str], None]) -> None:
        """Who is linked to us (session id, name of the certificate, address), from now on."""
        self._declared.append(callers(self._session, handler))

    def await_matched(self, publishers: Iterable[Publisher[Any]], timeout_s: float) -> list[str]:
        """Wait until somebody subscribes to each; the keys nobody subscribed to in time."""
        waiting = [publisher for publisher in publishers if not publisher.matched]
        deadline_s = time.monotonic() + timeout_s
        pause = threading.Event()
        while waiting and time.monotonic() < deadline_s:
            pause.wait(POLL_S)
            waiting = [publisher for publisher in waiting if not publisher.matched]
        return [publisher.key for publisher in waiting]

    @property
    def rejected(self) -> dict[str, int]:
        """How many frames and requests could not be read, by path."""
        counts = dict(self._desk.rejected)
        for mailbox in tuple(self._mailboxes):
            path = mailbox.topic.path
            counts[path] = counts.get(path, 0) + mailbox.rejected
        return counts

    def _encoder(self, robot: str | None) -> Encoder:
        return Encoder(*sender_of(self.role, robot or self.robot))

    def _subscriber(
        self, key: str, callback: Callable[[zenoh.Sample], None], history: int = 0
    ) -> Any:
        heard = self.line.through(callback)
        if history:
            return following(self._session, key, history, heard)
        return self._session.declare_subscriber(key, Callback(heard, indirect=False))


def open_bus(
    network: Network,
    role: Role | None,
    robot: str,
    now_ns: Callable[[], int] = time.monotonic_ns,
) -> Bus:
    """Join the bus; raises EndpointInUse, NoPeer or BadEndpoint with the endpoint named."""
    return Bus(network, role, robot, now_ns)
