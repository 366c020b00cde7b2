"""What a process may do on the bus: publish, listen, serve, ask, and show that it is there.

Callbacks run in Zenoh's receive thread, where a call into Zenoh or a wait would stall everything
that arrives: they store or enqueue, no more.
"""

import time
from collections.abc import Callable, Iterable
from functools import partial
from itertools import islice
from typing import Any, Self, TypeVar

import zenoh
from zenoh.handlers import Callback

from protocol.bus.faults.fault_injector import FaultInjector
from protocol.bus.late_join import following, told_ns, was_fetched
from protocol.bus.linger import DelayedClose
from protocol.bus.mailbox import Mailbox, Sample
from protocol.bus.network import Hub, Network
from protocol.bus.presence import MAX_TOKENS, Presence, TokenSet, presence_in
from protocol.bus.publisher import Publisher, await_ready
from protocol.bus.requester import Requester
from protocol.bus.service import Handler, ServiceQueue, ServiceRequest, attached_time, taken
from protocol.bus.session import bound_endpoints, called, gone, open_session
from protocol.bus.tls.access import may_fetch, operator_name
from protocol.bus.tls.certificate import holder
from protocol.bus.tls.config import shut
from protocol.bus.tls.peers import DialledPeers, callers
from protocol.sender import sender_of
from protocol.topics import (
    CLOCK_SERVICE,
    STOP,
    STOP_SERVICE,
    TOPICS,
    Role,
    Service,
    Topic,
    key_parts,
    operator_in,
    robot_name,
)
from protocol.wire.codec import Encoder
from protocol.wire.message import Message
from protocol.wire.messages import Timesync
from runtime.errors import LocalError

Take = Callable[[str, bytes, int], None]
"""Key, frame, and when it came in ns; for an event fetched afterwards, when it was told."""

M = TypeVar("M", bound=Message)


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
        self._watched: TokenSet | None = None
        self._desk = ServiceQueue()
        self.line = FaultInjector(network.trouble, now_ns)
        self.holder = holder(network.tls, role, robot)
        self._session = open_session(network)
        self._dialled = DialledPeers(self._session, network, self.holder, robot)
        self._lingering = DelayedClose()
        self._declared.append(callers(self._session, self._lingering.stop))
        self._asker = Requester(self._session, network, role, self.operator, self.holder, now_ns)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Drop what is unanswered, undeclare everything, leave."""
        self._asker.close()
        self._desk.close()
        session: Any = self._session
        session.close()
        self._lingering.close()
        self.line.close()

    @property
    def zid(self) -> str:
        return str(self._session.zid())

    @property
    def operator(self) -> str | None:
        """Return this operator's identity, the end of the keys it publishes and asks on.

        None for a process that is no operator, such as a viewer.
        """
        name = operator_name(self.holder) if self.role is Role.GROUND else None
        return None if name is None else f"{name}/{self.zid}"

    @property
    def now_ns(self) -> Callable[[], int]:
        """The clock of this process, in which a robot tells the ages of what arrives."""
        return self._now_ns

    def locator(self) -> str:
        """The endpoint others can dial, with the real port where 0 was asked for."""
        bound = bound_endpoints(self._session)
        if not bound:
            raise LocalError("this bus listens nowhere")
        return bound[0]

    def key(self, path: str, robot: str | None = None) -> str:
        return f"{self.network.prefix}/{robot_name(robot or self.robot)}/{path}"

    def publisher(self, topic: Topic[M], robot: str | None = None) -> Publisher[M]:
        """Return a publisher. An operator's has its identity in the key, and stamps what it sends
        with the robot's time, which is measured from now on."""
        name = robot or self.robot
        key, time_ns = self.key(topic.path, robot), None
        if topic.of_operators and self.operator is not None:
            key = f"{key}/{self.operator}"
            time_ns = partial(self._asker.clocks.time_ns, name)
            self._asker.clocks.follow(name)
        return Publisher(self._session, topic, key, self._encoder(robot), time_ns)

    def mailbox(
        self,
        topic: Topic[M],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
        accept: Callable[[str], bool] | None = None,
        *,
        forward: bool = False,
        check: Callable[[M], str] | None = None,
        take: Take | None = None,
    ) -> Mailbox[M]:
        """The newest message of a topic; `notify` gets each arrival (ns), in the bus's thread.

        `accept` and `check` are called in the bus's thread, too: see `Mailbox`. `take` gets every
        frame, as a handler of `stream` does, by the same subscription. What it gets of the topic's
        history is not stored in the mailbox.
        """
        mailbox = Mailbox(topic, notify, accept, forward=forward, check=check)
        now_ns = self._now_ns
        operators = f"{self.key(topic.path, robot)}/" if accept is not None else ""

        def store(sample: zenoh.Sample) -> None:
            arrived_ns = now_ns()
            found = Sample(str(sample.encoding), taken(sample.payload))
            if take is not None:
                take(str(sample.key_expr), found.payload, told_ns(sample, arrived_ns))
                if was_fetched(sample):
                    return
            if operators:
                sender = operator_in(str(sample.key_expr).removeprefix(operators))
                found = found._replace(sender=sender, sent_ns=attached_time(sample.attachment))
            mailbox.store(found, arrived_ns)

        history = 0 if take is None else self._history(topic, robot)
        key = self._heard_on(topic, robot)
        self._mailboxes[mailbox] = self._subscriber(key, store, history)
        return mailbox

    def forget(self, mailbox: Mailbox[Any]) -> None:
        """Listen no more: for those who only wanted to know something once."""
        subscriber = self._mailboxes.pop(mailbox, None)
        if subscriber is not None:
            subscriber.undeclare()

    def stream(self, source: Topic[Any] | str, handler: Take, robot: str | None = None) -> None:
        """Every frame of a topic, or of a key expression such as `sidestep/**`.

        Of a topic with a history also what was told before, and while nothing came through, if our
        certificate allows to ask for it.
        """
        now_ns = self._now_ns

        def forward(sample: zenoh.Sample) -> None:
            handler(str(sample.key_expr), sample.payload.to_bytes(), told_ns(sample, now_ns()))

        if isinstance(source, str):
            self._declared.append(self._subscriber(source, forward))
        else:
            key, history = self._heard_on(source, robot), self._history(source, robot)
            self._declared.append(self._subscriber(key, forward, history))

    def everything(self, handler: Take, robot: str | None = None) -> None:
        """Every frame of one robot, once each, with all that its topics' histories hold."""
        histories = [topic for topic in TOPICS if topic.history]
        apart = frozenset(topic.path for topic in histories)

        def rest(key: str, frame: bytes, arrived_ns: int) -> None:
            parts = key_parts(key)
            if parts is None or parts.path not in apart:
                handler(key, frame, arrived_ns)

        self.stream(self.key("**", robot), rest)
        for topic in histories:
            self.stream(topic, handler, robot)

    def serve(self, service: Service, handler: Handler, robot: str | None = None) -> None:
        """Answer a service: `handler` runs in the bus's request thread, the reply in any."""
        self._answer(service, robot, lambda asked: self._desk.put(asked, handler))

    def serve_clock(self) -> None:
        """Answer operators who ask for the time of this process."""

        def take(asked: ServiceRequest) -> None:
            arrived_ns = self._now_ns()
            self._desk.put(asked, lambda known: known.reply(time_answer(known.message, arrived_ns)))

        self._answer(CLOCK_SERVICE, None, take)

    def serve_stop(self, pressed: Callable[[str, bytes], None], handler: Handler) -> None:
        """Hand every emergency stop to `pressed` at once, in the bus's own thread.

        It gets the operator (empty when unknown) and the bytes that came, whatever they are.
        `handler` gets the requests of the service besides, as with `serve`.
        """
        beginning = f"{self.key(STOP.path)}/"

        def heard(sample: zenoh.Sample) -> None:
            operator = operator_in(str(sample.key_expr).removeprefix(beginning))
            pressed(operator, taken(sample.payload))

        def asked_for(asked: ServiceRequest) -> None:
            pressed(asked.operator, asked.payload)
            self._desk.put(asked, handler)

        self._declared.append(self._subscriber(self._heard_on(STOP, None), heard))
        self._answer(STOP_SERVICE, None, asked_for)

    def keep_serving(self) -> None:
        """Start the threads that answer again, if one has ended. Costs next to nothing."""
        self._desk.start()

    def _answer(
        self, service: Service, robot: str | None, take: Callable[[ServiceRequest], None]
    ) -> None:
        key, encoder, desk = self.key(service.path, robot), self._encoder(robot), self._desk
        now_ns = self._now_ns
        desk.start()

        def receive(query: zenoh.Query) -> None:
            take(ServiceRequest(query, key, service, encoder, desk.send, now_ns()))

        served = f"{key}/**" if service.of_operators else key
        callback = Callback(receive, indirect=False)
        self._declared.append(self._session.declare_queryable(served, callback))

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        """Return the answer, a message or the bytes of a JSON text; NoAnswer says why not.

        An operator's request ceases to count after `timeout_s`.
        """
        return self._asker.ask(service, message, timeout_s, robot_name(robot or self.robot))

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
            return sorted(self._watched.there)
        key = f"{self.network.prefix}/*/alive/*/*"
        replies = self._session.liveliness().get(key, timeout=timeout_s)
        keys = islice((str(reply.ok.key_expr) for reply in replies if reply.ok), MAX_TOKENS)
        return sorted({who for key in keys if (who := presence_in(key)) is not None})

    def hub(self) -> Hub:
        """Who links this session to the others; calls those it dialled when nobody does.

        A process with the certificate of another role links nobody: it counts as one that hangs.
        """
        info = self._session.info
        if self._dialled.wrong:
            return Hub.HANGS
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
        why = self._dialled.wrong or shut(self.network)
        return str(why or "")

    def lost(self) -> str:
        """Why nobody can be heard: the hub is gone, hangs or lets nobody in. Empty while linked."""
        hub = self.hub()
        shut_out = self.kept_out() if hub is Hub.HANGS else ""
        return shut_out or gone(hub, ", ".join(self.network.connect))

    def watch(self, handler: Callable[[Presence, bool], None]) -> None:
        """Who comes (True) and goes (False), those already there included; only enqueue."""
        tokens = self._watched = TokenSet(handler)

        def forward(sample: zenoh.Sample) -> None:
            who = presence_in(str(sample.key_expr))
            if who is not None:
                tokens.take(who, came=sample.kind == zenoh.SampleKind.PUT)

        key = f"{self.network.prefix}/*/alive/*/*"
        callback = Callback(forward, indirect=False)
        watcher = self._session.liveliness().declare_subscriber(key, callback, history=True)
        self._declared.append(watcher)

    def on_caller(self, handler: Callable[[str, str | None, str], None]) -> None:
        """Who is linked to us (session id, name of the certificate, address), from now on."""
        self._declared.append(callers(self._session, handler))

    def on_impostor(self, handler: Callable[[str], None]) -> None:
        """Hand on why a process that answers when it is dialled again is wrong, now and then."""
        self._dialled.on_wrong(handler)

    def await_matched(self, publishers: Iterable[Publisher[Any]], timeout_s: float) -> list[str]:
        """Wait until all are ready, and return the keys of those that were not in time."""
        return await_ready(publishers, timeout_s)

    @property
    def rejected(self) -> dict[str, int]:
        """How many frames and requests could not be read, by path."""
        counts = dict(self._desk.rejected)
        for mailbox in tuple(self._mailboxes):
            path = mailbox.topic.path
            counts[path] = counts.get(path, 0) + mailbox.rejected
        return counts

    def _heard_on(self, topic: Topic[Any], robot: str | None) -> str:
        """Return the key expression that a topic's samples come on, of all its operators."""
        key = self.key(topic.path, robot)
        return f"{key}/**" if topic.of_operators else key

    def _history(self, topic: Topic[Any], robot: str | None) -> int:
        """Return how many samples may be fetched of those that were told before."""
        return topic.history if may_fetch(self.holder, robot or self.robot, topic) else 0

    def _encoder(self, robot: str | None) -> Encoder:
        return Encoder(*sender_of(self.role, robot or self.robot))

    def _subscriber(
        self, key: str, callback: Callable[[zenoh.Sample], None], history: int = 0
    ) -> Any:
        heard = self.line.through(callback)
        if history:
            return following(self._session, key, history, heard)
        return self._session.declare_subscriber(key, Callback(heard, indirect=False))


def time_answer(question: Message | None, time_ns: int) -> Timesync:
    """Answer a TIMESYNC with the time at which it arrived."""
    asked_ns = question.ts1 if isinstance(question, Timesync) else 0
    return Timesync(tc1=time_ns, ts1=asked_ns)


def open_bus(
    network: Network,
    role: Role | None,
    robot: str,
    now_ns: Callable[[], int] = time.monotonic_ns,
) -> Bus:
    """Join the bus; raises EndpointInUse, NoPeer or BadEndpoint with the endpoint named."""
    return Bus(network, role, robot, now_ns)
