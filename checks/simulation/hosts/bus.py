"""A substitute for Zenoh, so that the real bus runs on a simulated network.

It offers what the bus uses of Zenoh: publishers, subscribers, queryables, queries and liveliness
tokens. All sessions share one hub with their declarations, samples and queries.

The network delays, loses and reorders frames between two hosts. Links have a direction. Without an
impairment the delay is constant, so frames stay in order.
"""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any, Final, NamedTuple

import zenoh
from zenoh.handlers import Callback

from checks.simulation.hosts.virtual_time import Host, Scheduler, Task, current_host, current_task
from runtime.units import NS_PER_MS, NS_PER_S

USUAL_DELAY_NS: Final = 300_000
GROWN_NS: Final = 4_000 * NS_PER_MS


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkImpairment:
    """The disturbance of a link; shares are from 0 to 1.

    `paths` are the prefixes of the topics it affects; all, if empty. With `growth` the delay has
    grown by this share of the time since `since_ns`, as behind a filling queue, up to GROWN_NS.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay_ns: int = 0
    jitter_ns: int = 0
    growth: float = 0.0
    since_ns: int = 0
    paths: tuple[str, ...] = ()

    def concerns(self, path: str) -> bool:
        """Return whether a topic is affected."""
        return not self.paths or path.startswith(self.paths)


class SimulatedLink:
    """The link from one host to another."""

    def __init__(self) -> None:
        self.impairments: tuple[tuple[LinkImpairment, Random], ...] = ()
        self.delay_ns = USUAL_DELAY_NS

    def add(self, impairment: LinkImpairment, salt: int) -> None:
        """Add an impairment."""
        self.impairments = (*self.impairments, (impairment, Random(salt)))

    def remove(self, impairment: LinkImpairment) -> None:
        """Remove an impairment."""
        self.impairments = tuple(
            (one, random) for one, random in self.impairments if one is not impairment
        )

    @property
    def cut(self) -> bool:
        """True if no frame passes."""
        return any(one.loss >= 1.0 and not one.paths for one, _ in self.impairments)

    def arrivals_ns(self, path: str, now_ns: int) -> list[int]:
        """Return the delay of each copy of a frame; empty if it is lost."""
        delays_ns = [self.delay_ns]
        for impairment, random in self.impairments:
            if not impairment.concerns(path):
                continue
            draw = random.random
            if draw() < impairment.loss:
                return []
            if draw() < impairment.duplicate:
                delays_ns.append(delays_ns[0] + round(draw() * 200 * NS_PER_MS))
            late_ns = impairment.delay_ns + round(draw() * impairment.jitter_ns)
            if impairment.growth:
                late_ns += min(round(impairment.growth * (now_ns - impairment.since_ns)), GROWN_NS)
            if draw() < impairment.reorder:
                late_ns += round(draw() * 120 * NS_PER_MS)
            delays_ns = [delay_ns + late_ns for delay_ns in delays_ns]
        return delays_ns


class SimulatedNetwork:
    """All links and their state."""

    def __init__(self, scheduler: Scheduler) -> None:
        self.scheduler = scheduler
        self._links: dict[tuple[str, str], SimulatedLink] = {}

        self.sent = 0

    def link(self, source: str, target: str) -> SimulatedLink:
        """Return the link from one host to another."""
        link = self._links.get((source, target))
        if link is None:
            link = self._links[source, target] = SimulatedLink()
        return link

    def connected(self, source: Host, target: Host) -> bool:
        """Return whether frames pass from one host to another."""
        return source.alive and target.alive and not self.link(source.name, target.name).cut

    def send(
        self, source: Host, target: Host, path: str, action: Callable[..., object], *arguments: Any
    ) -> None:
        """Call `action` at the target when the frame arrives, unless it is lost."""
        scheduler = self.scheduler
        self.sent += 1
        if source is target:
            scheduler.at(scheduler.now_ns, target.deliver, action, *arguments)
            return
        link = self._links.get((source.name, target.name)) or self.link(source.name, target.name)
        if not link.impairments:
            scheduler.at(scheduler.now_ns + link.delay_ns, target.deliver, action, *arguments)
            return
        for delay_ns in link.arrivals_ns(path, scheduler.now_ns):
            scheduler.at(scheduler.now_ns + delay_ns, target.deliver, action, *arguments)


WATCHED: Final = ("drive/", "sense/", "op/", "srv/", "tlm/status")
"""Prefixes of the topics and services that invariants or the attacker observe."""

MANY: Final = 10_000
Tap = Callable[[Host, str, bytes, bytes | None, bool], None]

Put: Final = zenoh.SampleKind.PUT
Delete: Final = zenoh.SampleKind.DELETE


class SimulatedBytes(bytes):
    """Replaces zenoh.ZBytes."""

    __slots__ = ()

    def to_bytes(self) -> bytes:
        """Return the bytes."""
        return self


class SimulatedSample:
    """Replaces zenoh.Sample."""

    __slots__ = (
        *("attachment", "encoding", "key_expr", "kind", "payload"),
        *("sent_ns", "source", "timestamp"),
    )
    congestion_control = zenoh.CongestionControl.DROP
    source_info = None

    def __init__(
        self,
        key: str,
        payload: bytes,
        encoding: str,
        attachment: bytes | None,
        source: Host,
        kind: object = Put,
    ) -> None:
        self.key_expr = key
        self.payload = SimulatedBytes(payload)
        self.encoding = encoding
        self.attachment = None if attachment is None else SimulatedBytes(attachment)
        self.kind = kind
        self.source = source
        self.sent_ns = source.scheduler.now_ns
        self.timestamp = None


class SimulatedReply:
    """Replaces zenoh.Reply; `ok` is None if no answer arrived in time."""

    __slots__ = ("err", "ok")

    def __init__(self, ok: SimulatedSample | None) -> None:
        self.ok = ok
        self.err = None


class PendingQuery:
    """A query that waits for its answers."""

    __slots__ = ("dropped", "replies", "task")

    def __init__(self, task: Task) -> None:
        self.task = task
        self.replies: list[SimulatedReply] = []
        self.dropped = False

    def answered(self, sample: SimulatedSample) -> None:
        """Add an answer."""
        self.replies.append(SimulatedReply(sample))
        self.task.wake()

    def drop(self) -> None:
        """End the query without an answer."""
        self.dropped = True
        self.task.wake()


class HandledQuery:
    """A query that nobody waits for: its handler gets the first answer, and is dropped."""

    __slots__ = ("_handler",)

    def __init__(self, handler: "Callback[Any]") -> None:
        self._handler: Callback[Any] | None = handler

    def answered(self, sample: SimulatedSample) -> None:
        """End the query with an answer."""
        self._end(SimulatedReply(sample))

    def drop(self) -> None:
        """End the query without an answer."""
        self._end()

    def expire(self) -> None:
        """End the query, because no answer has arrived in time."""
        self._end(SimulatedReply(None))

    def _end(self, *replies: SimulatedReply) -> None:
        handler, self._handler = self._handler, None
        if handler is not None:
            for reply in replies:
                handler(reply)
            if handler.drop is not None:
                handler.drop()


class SimulatedQuery:
    """Replaces zenoh.Query."""

    def __init__(
        self,
        hub: "SimulatedHub",
        server: Host,
        waiting: PendingQuery | HandledQuery,
        asked: SimulatedSample,
        *,
        has_payload: bool,
    ) -> None:
        self._hub = hub
        self._server = server
        self._waiting = waiting
        self._asked = asked
        self.key_expr = asked.key_expr
        self.attachment = asked.attachment
        self.payload = asked.payload if has_payload else None
        self.encoding = asked.encoding if has_payload else None
        self.source = asked.source

    def __enter__(self) -> "SimulatedQuery":
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: replies are final at once."""

    def reply(self, key: object, payload: bytes, *, encoding: object = "", **_: object) -> None:
        """Send a reply."""
        sample = SimulatedSample(str(key), payload, str(encoding), None, self._server)
        self._back(self._waiting.answered, sample)

    def reply_err(self, payload: object, **_: object) -> None:
        """Send an error, which ends the query."""
        self._back(self._waiting.drop)

    def drop(self) -> None:
        """End the query without a reply."""
        self._back(self._waiting.drop)

    def _back(self, action: Callable[..., object], *arguments: Any) -> None:
        if self._server.alive:
            source, path = self._asked.source, path_of(self.key_expr)
            self._hub.network.send(self._server, source, path, action, *arguments)


class Subscription:
    """A subscriber, queryable or liveliness token of a session."""

    __slots__ = ("callback", "host", "key", "session", "table")

    def __init__(
        self,
        key: str,
        session: "SimulatedSession",
        callback: Callable[[Any], object],
        table: "Declarations",
    ) -> None:
        self.key = key
        self.session = session
        self.host: Host = session.host
        self.callback = callback
        self.table = table

    def undeclare(self) -> None:
        """End the declaration."""
        self.table.remove(self)
        self.session.forget(self)


class Declarations:
    """Declarations by key expression, and the declarations that a key matches."""

    def __init__(self) -> None:
        self._all: list[Subscription] = []
        self._routes: dict[str, tuple[Subscription, ...]] = {}
        self.quiet: dict[str, bool] = {}
        """Keys that no declaration matches, valid until a declaration changes."""

    def add(self, one: Subscription) -> Subscription:
        """Add a declaration."""
        self._all.append(one)
        self._routes.clear()
        self.quiet.clear()
        return one

    def remove(self, one: Subscription) -> None:
        """Remove a declaration."""
        if one in self._all:
            self._all.remove(one)
            self._routes.clear()
            self.quiet.clear()

    def leave(self, session: "SimulatedSession") -> list[Subscription]:
        """Remove and return the declarations of a session that has ended or lost its link."""
        gone = [one for one in self._all if one.session is session]
        self._all = [one for one in self._all if one.session is not session]
        self._routes.clear()
        self.quiet.clear()
        return gone

    def met_by(self, key: str) -> tuple[Subscription, ...]:
        """Return the declarations that a key matches."""
        found = self._routes.get(key)
        if found is None:
            found = tuple(one for one in self._all if intersects(one.key, key))
            self._routes[key] = found
        return found


_INTERSECTS: dict[tuple[str, str], bool] = {}


def intersects(one: str, other: str) -> bool:
    """Return whether two key expressions intersect, as Zenoh defines it."""
    found = _INTERSECTS.get((one, other))
    if found is None:
        found = _INTERSECTS[one, other] = zenoh.KeyExpr(one).intersects(zenoh.KeyExpr(other))
    return found


_PATHS: dict[str, str] = {}


def path_of(key: str) -> str:
    """Return the part of a key after prefix and robot; empty for a key without them."""
    path = _PATHS.get(key)
    if path is None:
        path = key.partition("/")[2].partition("/")[2]
        if len(_PATHS) < MANY:
            _PATHS[key] = path
    return path


class SimulatedHub:
    """The shared state of all sessions of a simulation."""

    def __init__(self, network: SimulatedNetwork) -> None:
        self.network = network
        self.subscribers = Declarations()
        self.queryables = Declarations()
        self.tokens = Declarations()
        self.watchers = Declarations()
        self.taps: list[Tap] = []
        """Called with each frame that is put or asked: source, key, payload, attachment, asked."""
        self.arrivals: list[Callable[[SimulatedSample], None]] = []
        """Called with each operator sample that arrives at the robot, before its subscriber."""
        self.asked: list[Callable[[SimulatedQuery], None]] = []
        """Called with each query that arrives at the robot, before its queryable."""

    @staticmethod
    def with_taps(
        taps: list[Callable[[Any], None]], callback: Callable[[Any], object]
    ) -> Callable[[Any], object]:
        """Return a callback that passes an arrival to the taps, then to `callback`."""

        def take(arrival: Any) -> None:
            for tap in taps:
                tap(arrival)
            callback(arrival)

        return take

    def leave(self, session: "SimulatedSession") -> list[Subscription]:
        """Remove and return the declarations of a session without a link, and announce that."""
        tables = self.subscribers, self.queryables, self.watchers
        gone = [one for table in tables for one in table.leave(session)]
        tokens = self.tokens.leave(session)
        for token in tokens:
            self.announce(token, Delete)
        return gone + tokens

    def join(self, declared: list[Subscription]) -> None:
        """Add the declarations of a session that is linked again, and announce its tokens."""
        for one in declared:
            one.table.add(one)
            if one.table is self.tokens:
                self.announce(one, Put)

    def announce(self, token: Subscription, kind: object) -> None:
        """Announce to its watchers that a token was declared or removed."""
        for watcher in self.watchers.met_by(token.key):
            sample = SimulatedSample(token.key, b"", "", None, token.host, kind)
            scheduler = self.network.scheduler
            scheduler.at(scheduler.now_ns, watcher.host.call, watcher.callback, sample)

    def put(self, source: Host, key: str, frame: bytes, encoding: str, note: bytes | None) -> None:
        """Send a sample to all subscribers of its key."""
        if not source.alive or self.quiet(key):
            return
        path = path_of(key)
        if path.startswith(WATCHED) and not (source.name == "plant" and path.startswith("sense/")):
            for tap in self.taps:
                tap(source, key, frame, note, False)
        found = self.subscribers.met_by(key)
        if not found:
            return
        network, sample = self.network, SimulatedSample(key, frame, encoding, note, source)
        for one in found:
            network.send(source, one.host, path, one.callback, sample)

    def quiet(self, key: str) -> bool:
        """Return whether neither a subscriber nor an invariant observes a key."""
        found = self.subscribers.quiet.get(key)
        if found is None:
            listened = self.subscribers.met_by(key) or path_of(key).startswith(WATCHED)
            found = self.subscribers.quiet[key] = not listened
        return found

    def ask(
        self, asked: SimulatedSample, waiting: PendingQuery | HandledQuery, *, has_payload: bool
    ) -> bool:
        """Send a query to its servers; return False when there is none."""
        for tap in self.taps:
            tap(asked.source, asked.key_expr, asked.payload, asked.attachment, True)
        found = self.queryables.met_by(asked.key_expr)
        for one in found:
            query = SimulatedQuery(self, one.host, waiting, asked, has_payload=has_payload)
            path = path_of(asked.key_expr)
            self.network.send(asked.source, one.host, path, one.callback, query)
        return bool(found)


class SimulatedInfo:
    """Replaces zenoh.SessionInfo."""

    def __init__(self, session: "SimulatedSession", peers: list[str]) -> None:
        self._session = session
        self._peers = peers

    def links(self) -> list[str]:
        """Return the link to the hub, if there is one."""
        return ["link"] if self._session.linked else []

    def routers_zid(self) -> list[str]:
        """Return no routers."""
        return []

    def peers_zid(self) -> list[str]:
        """Return the connected peers."""
        return self._peers

    def declare_transport_events_listener(
        self, callback: Callable[[Any], object], *, history: bool
    ) -> None:
        """Call `callback` when the transport begins or ends, which has one link."""
        self._session.follow(callback)

    def declare_link_events_listener(
        self, callback: Callable[[Any], object], *, history: bool
    ) -> None:
        """Call `callback` when the link begins or ends."""
        self._session.follow(callback)


class SimulatedEnd(NamedTuple):
    """Replaces zenoh.Link and zenoh.Transport: the other end, whose certificate is unknown."""

    zid: str = "hub"
    auth_identifier: str | None = None
    dst: str = "tcp/hub:7447"


class SimulatedLinkEvent(NamedTuple):
    """Replaces zenoh.LinkEvent and zenoh.TransportEvent."""

    kind: object
    link: SimulatedEnd = SimulatedEnd()
    transport: SimulatedEnd = SimulatedEnd()


class SimulatedPublisher:
    """Replaces zenoh.Publisher."""

    def __init__(self, session: "SimulatedSession", key: str, encoding: str) -> None:
        self._session = session
        self._key = key
        self._encoding = encoding

    def put(self, payload: bytes, *, attachment: object = None, **_: object) -> None:
        """Publish a payload."""
        session = self._session
        if session.linked:
            session.hub.put(session.host, self._key, payload, self._encoding, note_of(attachment))

    @property
    def quiet(self) -> bool:
        """True if nothing observes the key."""
        return self._session.hub.quiet(self._key)

    @property
    def matched(self) -> bool:
        """True if there is a subscriber."""
        return bool(self._session.hub.subscribers.met_by(self._key))

    def undeclare(self) -> None:
        """Do nothing: a publisher has no state."""


class SimulatedLiveliness:
    """Replaces zenoh.Liveliness."""

    def __init__(self, session: "SimulatedSession") -> None:
        self._session = session

    def declare_token(self, key: str) -> Subscription:
        """Declare a token."""
        hub = self._session.hub
        token = Subscription(key, self._session, lambda _: None, hub.tokens)
        return self._session.declare(token)

    def get(self, key: str, **_: object) -> list[SimulatedReply]:
        """Return the tokens of connected hosts."""
        hub, host = self._session.hub, self._session.host
        found = hub.tokens.met_by(key) if self._session.linked else ()
        here = [one for one in found if one.host is host or hub.network.connected(one.host, host)]
        return [SimulatedReply(SimulatedSample(one.key, b"", "", None, one.host)) for one in here]

    def declare_subscriber(
        self, key: str, callback: Callable[[Any], object], *, history: bool = False
    ) -> Subscription:
        """Subscribe to tokens."""
        hub = self._session.hub
        watcher = Subscription(key, self._session, callback, hub.watchers)
        self._session.declare(watcher)
        if history:
            for reply in self.get(key):
                callback(reply.ok)
        return watcher


class SimulatedSession:
    """Replaces zenoh.Session in the host that opens it.

    Without its link it neither sends nor receives; what it has declared waits for the link.
    """

    def __init__(self, hub: SimulatedHub, zid: str) -> None:
        self.hub = hub
        self.host = current_host()
        self._zid = zid
        self.linked = True
        self.watchers: list[Callable[[Any], object]] = []
        self._waiting: list[Subscription] = []
        self._closed = False

    def declare(self, one: Subscription) -> Subscription:
        """Declare something, now or when there is a link."""
        if self.linked:
            self.hub.join([one])
        else:
            self._waiting.append(one)
        return one

    def forget(self, one: Subscription) -> None:
        """Declare something no more when there is a link again."""
        self._waiting = [other for other in self._waiting if other is not one]

    def follow(self, watcher: Callable[[Any], object]) -> None:
        """Call a function when the link begins or ends, and now if it is there."""
        self.watchers.append(watcher)
        if self.linked:
            self.host.call(watcher, SimulatedLinkEvent(Put))

    def lose_link(self) -> None:
        """Lose the link."""
        if self.linked:
            self.linked = False
            self._waiting = self.hub.leave(self)
            self._report(Delete)

    def regain_link(self) -> None:
        """Have a link again."""
        if not (self.linked or self._closed):
            self.linked = True
            waiting, self._waiting = self._waiting, []
            self.hub.join(waiting)
            self._report(Put)

    def _report(self, kind: object) -> None:
        for watcher in self.watchers:
            self.host.call(watcher, SimulatedLinkEvent(kind))

    def zid(self) -> str:
        """Return the id of the session."""
        return self._zid

    @property
    def info(self) -> SimulatedInfo:
        """The connected peers: the robot's host while it is there, as hub of the topology."""
        network = self.hub.network
        robots = [one.host for one in self.hub.tokens.met_by("sidestep/*/alive/robot/*")]
        linked = [host.name for host in robots if network.connected(host, self.host)]
        return SimulatedInfo(self, linked if self.linked else [])

    def declare_publisher(
        self, key: str, *, encoding: object = "", **_: object
    ) -> SimulatedPublisher:
        """Declare a publisher."""
        return SimulatedPublisher(self, str(key), str(encoding))

    def declare_subscriber(self, key: str, callback: Callable[[Any], object]) -> Subscription:
        """Declare a subscriber."""
        table = self.hub.subscribers
        if self.host.name == "robot" and "/op/" in str(key):
            callback = self.hub.with_taps(self.hub.arrivals, callback)
        return self.declare(Subscription(str(key), self, callback, table))

    def declare_queryable(
        self, key: str, callback: Callable[[Any], object], **_: object
    ) -> Subscription:
        """Declare a queryable."""
        table = self.hub.queryables
        if self.host.name == "robot":
            callback = self.hub.with_taps(self.hub.asked, callback)
        return self.declare(Subscription(str(key), self, callback, table))

    def liveliness(self) -> SimulatedLiveliness:
        """Return the liveliness tokens."""
        return SimulatedLiveliness(self)

    def new_timestamp(self) -> None:
        """Return no time stamp."""
        return

    def put(
        self,
        key: str,
        payload: bytes,
        *,
        encoding: object = "",
        attachment: object = None,
        **_: object,
    ) -> None:
        """Publish on a key."""
        if self.linked:
            self.hub.put(self.host, str(key), payload, str(encoding), note_of(attachment))

    def get(
        self,
        key: str,
        handler: "Callback[Any] | None" = None,
        *,
        payload: bytes | None = None,
        encoding: object = None,
        timeout: float = 10.0,
        attachment: object = None,
        **_: object,
    ) -> list[SimulatedReply]:
        """Wait for one answer; a reply has no `ok` if none arrives in time.

        With a handler this waits for nothing: the handler gets that reply.
        """
        has_payload, note = payload is not None, note_of(attachment)
        words = "" if encoding is None else str(encoding)
        asked = SimulatedSample(str(key), payload or b"", words, note, self.host)
        scheduler = self.host.scheduler
        deadline_ns = scheduler.now_ns + round(timeout * NS_PER_S)
        if handler is not None:
            handled = HandledQuery(handler)
            if not self.linked or not self.hub.ask(asked, handled, has_payload=has_payload):
                handled.drop()
            scheduler.at(deadline_ns, self.host.call, handled.expire)
            return []
        task = current_task()
        waiting = PendingQuery(task)
        if not self.linked or not self.hub.ask(asked, waiting, has_payload=has_payload):
            return []
        while not waiting.replies and not waiting.dropped and scheduler.now_ns < deadline_ns:
            task.wait_until(deadline_ns)
        return waiting.replies or ([] if waiting.dropped else [SimulatedReply(None)])

    def close(self) -> None:
        """Remove all declarations of the session."""
        self.linked, self._closed = False, True
        self.hub.leave(self)


def note_of(attachment: object) -> bytes | None:
    """Return an attachment as bytes."""
    if attachment is None:
        return None
    return attachment.encode() if isinstance(attachment, str) else bytes(attachment)  # type: ignore[call-overload]
