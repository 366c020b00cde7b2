"""The bus of a process: publish, subscribe, serve, query, and the presence of it and of others.

Callbacks run in Zenoh's receive thread. A query or a wait would block all reception there, so they
only store or enqueue. The exception is the robot's cycle in lockstep, which also publishes there.

There is one process per role and robot. `claim` checks once, at the start. A network failure can
hide two processes from each other; `DuplicateWatch` detects them after the network has recovered.
"""

import re
import threading
import time
from collections.abc import Callable, Iterable
from copy import copy
from functools import partial
from itertools import islice
from typing import Any, Final, NamedTuple, Self, TypeVar

import zenoh

from protocol.bus.callbacks import zenoh_callback
from protocol.bus.fault_injector import FaultInjector
from protocol.bus.mailbox import Mailbox, Sample
from protocol.bus.network import Hub, Network, person_here
from protocol.bus.peers import AcceptedPeers, DialledPeers, RefusedLink, callers
from protocol.bus.publisher import (
    Publisher,
    fetching_subscriber,
    published_ns,
    was_fetched,
)
from protocol.bus.rights import OPEN, ends_of, may_fetch, operator_name
from protocol.bus.services import (
    Handler,
    Requester,
    ServiceQueue,
    ServiceRequest,
    attached_time,
    payload_bytes,
)
from protocol.bus.session import (
    KEEPER_SILENT_S,
    SILENT_S,
    LastingSession,
    bound_endpoints,
    close_session,
    holder,
    is_linked,
    loss_text,
    open_session,
    peer_refusal,
    probed,
    redialled,
)
from protocol.bus.sockets import LinkCloser
from protocol.topic import ROBOT_NAME
from protocol.topics import (
    CLOCK_SERVICE,
    STOP,
    STOP_SERVICE,
    SUMMARIES,
    TOPICS,
    Role,
    Service,
    Topic,
    operator_in,
    robot_name,
    sender_of,
)
from protocol.wire.codec import Encoder
from protocol.wire.message import Message
from protocol.wire.messages import Timesync
from runtime.errors import LocalError, UserError
from runtime.units import NS_PER_S
from runtime.watchdog import Patience

ROLES: Final = frozenset(role.value for role in Role)
SESSION: Final = re.compile(r"[0-9a-f]{1,32}\Z")
POLL_S: Final = 0.001
ROUNDS: Final = 20
"""A control loop keeps the bus serving in each cycle; to look at its threads once a second is
enough."""

PRESENT_S: Final = 10.0
MAX_TOKENS: Final = 1000
"""Limit of tracked tokens, of all robots together."""


class Presence(NamedTuple):
    """A process's liveliness token: process and link are alive, but its loop may hang."""

    robot: str
    role: str
    zid: str


class TokenSet:
    """The present tokens; `handler` is called for each that appears (True) or disappears (False).

    Zenoh has a thread for each of several links, so tokens may arrive in several threads at once.
    The calls of `handler` never overlap.
    """

    def __init__(self, handler: Callable[[Presence, bool], None]) -> None:
        self.there: frozenset[Presence] = frozenset()
        self._handler = handler
        self._taking = threading.Lock()

    def take(self, token: Presence, *, appeared: bool) -> None:
        """Add or remove a token, unless there are too many; may be called from any thread."""
        with self._taking:
            if appeared and len(self.there) >= MAX_TOKENS:
                return
            self.there = self.there | {token} if appeared else self.there - {token}
            self._handler(token, appeared)

    def clear(self) -> None:
        """Remove all tokens."""
        for token in self.there:
            self.take(token, appeared=False)


def presence_in(key: str) -> Presence | None:
    """Return the token of a key; None unless robot, role and session are valid."""
    robot, _, role, zid = key.split("/")[-4:]
    known = ROBOT_NAME.match(robot) and role in ROLES and SESSION.match(zid)
    return Presence(robot, role, zid) if known else None


Take = Callable[[str, bytes, int], None]
"""Key, frame and time of arrival in ns; for a cached event, the time of its publication."""

M = TypeVar("M", bound=Message)


class Bus:
    """One session of one process. It must be closed, best by `with`.

    A process that dials replaces its session by a fresh one if its link does not come back, though
    a process listens there; its identity remains.
    """

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
        self._mailboxes: dict[Mailbox[Any], Any] = {}  # mailbox: its subscriber
        self._declared: list[object] = []
        self._watched: TokenSet | None = None
        self._queue = ServiceQueue()
        self._rounds = 0
        self.faults = FaultInjector(network.trouble, now_ns)
        self.holder = holder(network.tls, role, robot)
        self._person = operator_name(self.holder) if role is Role.GROUND else None
        if self._person == OPEN:
            self._person = network.person or person_here()
        session = open_session(network)
        self.zid = str(session.zid())
        """The id of this process, that of its first session."""

        self._report_link: Callable[[str], None] = lambda _why: None
        dials = bool(network.connect) and not network.listen
        accepts = self._accepts if dials else None
        silent_s = SILENT_S if role in (Role.GROUND, None) else KEEPER_SILENT_S
        self._sessions = LastingSession(session, self._open_fresh, accepts, silent_s)
        self._dialled = self._sessions.declare(self._follow_dialled)
        self._dialled.now.refuse()
        self._links = LinkCloser()
        self._declare(lambda one: callers(one, self._links.stop_lingering))
        self._accepted = None
        if network.tls is not None and network.listen:
            self._accepted = AcceptedPeers(session, self._links.end)
        self.requester = Requester(
            self._sessions, network, role, self.operator, self.holder, now_ns
        )

    def beside(self, robot: str) -> "Bus":
        """Return the bus of another robot of this process, which shares session and threads.

        It ends with this one and must not be closed. Frames of this robot alone are its own, and
        so are their mailboxes and its encoders; requests that were rejected are counted together.
        """
        other = copy(self)
        other.robot = robot_name(robot)
        other._mailboxes, other._declared, other._watched = {}, [], None
        return other

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Drop unanswered requests, undeclare everything and close the session."""
        self.requester.clocks.close()
        self._queue.close()
        self._sessions.close()
        self._links.close()
        self.faults.close()

    @property
    def _session(self) -> zenoh.Session:
        """The present session."""
        return self._sessions.now

    def _declare(self, declare: Callable[[zenoh.Session], object]) -> None:
        """Declare something until the bus is closed, on each session that it has."""
        self._declared.append(self._sessions.declare(declare))

    def _accepts(self) -> bool:
        """Return whether a dialled process accepts a TCP connection."""
        return any(probed(endpoint) is Hub.HANGS for endpoint in self.network.connect)

    def _open_fresh(self) -> zenoh.Session | None:
        """Return another session, or None if no right process accepts it."""
        try:
            session = redialled(self.network)
            DialledPeers(session, self.network, self.holder, self.robot).refuse()
        except (zenoh.ZError, UserError):
            return None
        if is_linked(session):
            return session
        close_session(session)
        return None

    def _follow_dialled(self, session: zenoh.Session) -> DialledPeers:
        """Check the certificates of the processes that a session dials, also later."""
        if str(session.zid()) != self.zid:
            self._report_link(
                f"the process at {', '.join(self.network.connect)} accepts connections, but the "
                f"link did not come back: a fresh session, {session.zid()}, replaces it"
            )
        dialled = DialledPeers(session, self.network, self.holder, self.robot)
        dialled.on_wrong(self._report_link)
        return dialled

    @property
    def operator(self) -> str | None:
        """This operator's identity, the end of the keys on which it publishes and queries.

        It is PERSON/SESSION: the programs of one person share what that person may do. It remains
        when a fresh session is opened. None for a process that is no operator, such as a viewer.
        """
        return None if self._person is None else f"{self._person}/{self.zid}"

    @property
    def now_ns(self) -> Callable[[], int]:
        """The clock of this process; a robot measures the ages of messages with it."""
        return self._now_ns

    def locator(self) -> str:
        """Return the endpoint that others can dial, with the real port if 0 was configured."""
        bound = bound_endpoints(self._session)
        if not bound:
            raise LocalError("this bus does not listen on any endpoint")
        return bound[0]

    def key(self, path: str, robot: str | None = None) -> str:
        """Return the key of a path below the robot's name."""
        return f"{self.network.prefix}/{robot_name(robot or self.robot)}/{path}"

    def publisher(self, topic: Topic[M], robot: str | None = None) -> Publisher[M]:
        """Return a publisher of a topic.

        An operator's key contains its identity; samples of its streams carry the robot's time.
        """
        name = robot or self.robot
        key, time_ns = self.key(topic.path, robot), None
        if topic.of_operators and self.operator is not None:
            key = f"{key}/{self.operator}"
            if topic.rate_hz:
                time_ns = partial(self.requester.clocks.time_ns, name)
                self.requester.clocks.follow(name)
        return Publisher(self._sessions, topic, key, self._encoder(robot), time_ns)

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
        """Return a mailbox with the newest message of a topic.

        `notify` is called with the time of each arrival in ns. `accept` and `check`: see `Mailbox`.
        `take` receives every frame of the subscription, as a handler of `stream` does; cached
        events go only to `take`. All callbacks run in the bus's thread.
        """
        mailbox = Mailbox(topic, notify, accept, forward=forward, check=check)
        now_ns = self._now_ns
        operators = f"{self.key(topic.path, robot)}/" if accept is not None else ""

        def store(sample: zenoh.Sample) -> None:
            arrived_ns = now_ns()
            found = Sample(str(sample.encoding), payload_bytes(sample.payload))
            if take is not None:
                take(str(sample.key_expr), found.payload, published_ns(sample, arrived_ns))
                if was_fetched(sample):
                    return
            if operators:
                sender = operator_in(str(sample.key_expr).removeprefix(operators))
                found = found._replace(sender=sender, sent_ns=attached_time(sample.attachment))
            mailbox.store(found, arrived_ns)

        history = 0 if take is None else self._history(topic, robot)
        key = self._subscription_keys(topic, robot)[-1]
        self._mailboxes[mailbox] = self._subscriber(key, store, history)
        return mailbox

    def unsubscribe(self, mailbox: Mailbox[Any]) -> None:
        """End the subscription of a mailbox that is needed no more."""
        subscriber = self._mailboxes.pop(mailbox, None)
        if subscriber is not None:
            self._sessions.undeclare(subscriber)

    def stream(self, topic: Topic[Any], handler: Take, robot: str | None = None) -> None:
        """Subscribe to every frame of a topic.

        If the topic has a history that our certificate permits to fetch, the handler also receives
        its cached events and those missed during an interruption.
        """
        now_ns = self._now_ns

        def forward(sample: zenoh.Sample) -> None:
            handler(str(sample.key_expr), sample.payload.to_bytes(), published_ns(sample, now_ns()))

        history = self._history(topic, robot)
        for key in self._subscription_keys(topic, robot):
            self._declared.append(self._subscriber(key, forward, history))

    def stream_all(self, handler: Take, robot: str | None = None) -> None:
        """Subscribe to all of one robot, each message once, with the history of all topics."""
        for topic in TOPICS:
            if topic not in SUMMARIES.values():
                self.stream(topic, handler, robot)

    def serve(self, service: Service, handler: Handler, robot: str | None = None) -> None:
        """Serve a service: `handler` runs in the request thread and may reply from any thread."""
        self._answer(service, robot, lambda request: self._queue.put(request, handler))

    def serve_clock(self) -> None:
        """Serve the clock of this process to operators."""

        def take(request: ServiceRequest) -> None:
            arrived_ns = self._now_ns()
            self._queue.put(request, lambda read: read.reply(time_answer(read.message, arrived_ns)))

        self._answer(CLOCK_SERVICE, None, take)

    def serve_stop(self, pressed: Callable[[str, bytes], None], handler: Handler) -> None:
        """Call `pressed` for every emergency stop at once, in the bus's own thread.

        It receives the operator (empty if unknown) and the payload, valid or not. `handler` also
        receives the requests of the service, as with `serve`.
        """
        prefix = f"{self.key(STOP.path)}/"

        def receive(sample: zenoh.Sample) -> None:
            operator = operator_in(str(sample.key_expr).removeprefix(prefix))
            pressed(operator, payload_bytes(sample.payload))

        def take(request: ServiceRequest) -> None:
            pressed(request.operator, request.payload)
            self._queue.put(request, handler)

        for key in self._subscription_keys(STOP, None):
            self._declared.append(self._subscriber(key, receive))
        self._answer(STOP_SERVICE, None, take)

    def keep_serving(self) -> None:
        """Restart the threads that answer if one has ended, in one of `ROUNDS` calls."""
        self._rounds = (self._rounds + 1) % ROUNDS
        if not self._rounds:
            self._queue.start()

    def _answer(
        self, service: Service, robot: str | None, take: Callable[[ServiceRequest], None]
    ) -> None:
        key, encoder, queue = self.key(service.path, robot), self._encoder(robot), self._queue
        queue.start()

        def receive(query: zenoh.Query) -> None:
            take(ServiceRequest(query, key, service, encoder, queue.send))

        for end in ends_of(service):
            callback = zenoh_callback(receive)
            self._declare(partial(queryable, f"{key}{end}", callback))

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        """Return the answer, a message or JSON bytes; NoAnswerError has the cause.

        An operator's request expires after `timeout_s`.
        """
        name = robot_name(robot or self.robot)
        return self.requester.run(self.requester.steps(service, message, timeout_s, name))

    def announce(self, robot: str | None = None) -> None:
        """Announce this process for a robot until the session ends."""
        if self.role is None:
            raise LocalError("a process without a role cannot announce itself")
        key = self.key(f"alive/{self.role.value}/{self.zid}", robot)
        self._declare(lambda one: one.liveliness().declare_token(key))

    def present(self) -> list[Presence]:
        """Return the announced processes of all robots of this prefix.

        A query without an answer looks as if nobody were there, so it has time on a busy machine;
        the end of the link ends it.

        A session that watches answers from its own state: Zenoh 1.10 does not answer such a query
        for some time after each token that its own subscriber received.
        """
        if self._watched is not None:
            return sorted(self._watched.there)
        key = f"{self.network.prefix}/*/alive/*/*"
        replies = self._session.liveliness().get(key, timeout=PRESENT_S)
        keys = islice((str(reply.ok.key_expr) for reply in replies if reply.ok), MAX_TOKENS)
        return sorted({token for key in keys if (token := presence_in(key)) is not None})

    def hub(self) -> Hub:
        """Return the state of the link to others; probe the dialled endpoints if there is none.

        A dialled process with the certificate of a wrong role counts as one that hangs.
        """
        info = self._session.info
        if self._dialled.now.wrong:
            return Hub.HANGS
        if list(info.routers_zid()):
            return Hub.ROUTER
        if list(info.peers_zid()) or not self.network.connect:
            return Hub.PEER
        calls = {probed(endpoint) for endpoint in self.network.connect}
        return next(hub for hub in (Hub.HANGS, Hub.ENDED, Hub.UNREACHABLE) if hub in calls)

    def kept_out(self) -> str:
        """Return why the dialled processes refuse this one; empty if they do not.

        Takes up to two seconds for each process that accepts the connection but does not answer.
        """
        return str(self._dialled.now.wrong or peer_refusal(self.network) or "")

    def lost(self) -> str:
        """Return why there is no link: the hub has ended, hangs or refuses. Empty while linked."""
        hub = self.hub()
        refusal = self.kept_out() if hub is Hub.HANGS else ""
        return refusal or loss_text(hub, ", ".join(self.network.connect))

    def watch(self, handler: Callable[[Presence, bool], None]) -> None:
        """Call `handler` for each process that appears (True) or disappears (False).

        Processes that are already present are included. `handler` must only enqueue.
        """
        tokens = self._watched = TokenSet(handler)

        key = f"{self.network.prefix}/*/alive/*/*"

        def declare(one: zenoh.Session) -> object:
            def forward(sample: zenoh.Sample) -> None:
                token = presence_in(str(sample.key_expr))
                if token is not None and one is self._session:
                    tokens.take(token, appeared=sample.kind == zenoh.SampleKind.PUT)

            tokens.clear()  # those of an earlier session
            callback = zenoh_callback(forward)
            return one.liveliness().declare_subscriber(key, callback, history=True)

        self._declare(declare)

    def on_caller(self, handler: Callable[[str, str | None, str], None]) -> None:
        """Call `handler` for each linked process: session id, name of its certificate, address."""
        self._declare(lambda one: callers(one, handler))

    def on_refused(self, handler: Callable[[RefusedLink], None]) -> None:
        """Call `handler` for each link that used the session id of another certificate."""
        if self._accepted is not None:
            self._accepted.on_refused(handler)

    def on_impostor(self, handler: Callable[[str], None]) -> None:
        """Call `handler`, at a limited rate, with the reason why a dialled process is wrong.

        It is also called when a fresh session has replaced one that was not taken back.
        """
        self._report_link = handler
        self._dialled.now.on_wrong(handler)

    def await_matched(self, publishers: Iterable[Publisher[Any]], timeout_s: float) -> list[str]:
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

    @property
    def rejected(self) -> dict[str, int]:
        """Numbers of rejected frames and requests, by path."""
        counts = dict(self._queue.rejected)
        for mailbox in tuple(self._mailboxes):
            path = mailbox.topic.path
            counts[path] = counts.get(path, 0) + mailbox.rejected
        return counts

    def _subscription_keys(self, topic: Topic[Any], robot: str | None) -> tuple[str, ...]:
        """Return the key expressions of a topic's samples, of all operators."""
        return tuple(f"{self.key(topic.path, robot)}{end}" for end in ends_of(topic))

    def _history(self, topic: Topic[Any], robot: str | None) -> int:
        """Return how many cached samples of a topic may be fetched."""
        return topic.history if may_fetch(self.holder, robot or self.robot, topic) else 0

    def _encoder(self, robot: str | None) -> Encoder:
        return Encoder(*sender_of(self.role, robot or self.robot))

    def _subscriber(
        self, key: str, callback: Callable[[zenoh.Sample], None], history: int = 0
    ) -> Any:
        receive = self.faults.wrapped(callback)
        if history:
            return fetching_subscriber(self._sessions, key, history, receive)
        callback = zenoh_callback(receive)
        return self._sessions.declare(lambda one: one.declare_subscriber(key, callback))


def time_answer(question: Message | None, time_ns: int) -> Timesync:
    """Return the answer to a TIMESYNC, with the time at which it arrived."""
    asked_ns = question.ts1 if isinstance(question, Timesync) else 0
    return Timesync(tc1=time_ns, ts1=asked_ns)


def queryable(key: str, callback: Any, session: zenoh.Session) -> object:
    """Declare that a session answers queries of a key."""
    return session.declare_queryable(key, callback)


def open_bus(
    network: Network,
    role: Role | None,
    robot: str,
    now_ns: Callable[[], int] = time.monotonic_ns,
) -> Bus:
    """Join the bus; raise EndpointInUseError, NoPeerError or EndpointError with the endpoint."""
    return Bus(network, role, robot, now_ns)


class NameTakenError(UserError):
    """Another process has this role for this robot."""


def claim(bus: Bus, robots: list[str]) -> None:
    """Announce this process, unless another one has its role; of two at once, the smaller id stays.

    Raises NameTakenError, which names the robot and the session of the other process.
    """
    raise_if_taken(bus, duplicates(bus, robots))
    for robot in robots:
        bus.announce(robot)
    raise_if_taken(bus, [(robot, zid) for robot, zid in duplicates(bus, robots) if zid < bus.zid])


class DuplicateWatch:
    """The other processes with this process's role and robot, while they are present."""

    def __init__(self, bus: Bus) -> None:
        self._own = bus.robot, None if bus.role is None else bus.role.value
        self._zid = bus.zid
        self._others: frozenset[str] = frozenset()
        bus.watch(self._see)

    def __bool__(self) -> bool:
        return bool(self._others)

    def _see(self, token: Presence, appeared: bool) -> None:
        """Update the set of duplicates; called in the bus's thread."""
        if (token.robot, token.role) == self._own and token.zid != self._zid:
            other = {token.zid}
            self._others = self._others | other if appeared else self._others - other


def duplicates(bus: Bus, robots: list[str]) -> list[tuple[str, str]]:
    """Return robot and session of each other process with the role of this one."""
    assert bus.role is not None
    return [
        (robot, zid)
        for robot, role, zid in bus.present()
        if role == bus.role.value and robot in robots and zid != bus.zid
    ]


def raise_if_taken(bus: Bus, others: list[tuple[str, str]]) -> None:
    """Raise NameTakenError if there is another process."""
    if others and bus.role is not None:
        robot, zid = others[0]
        raise NameTakenError(
            f"there is a {bus.role.value} for {robot} already (session {zid}): "
            "stop it, or choose another name or endpoint"
        )
