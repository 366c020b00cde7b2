"""The shared state of all simulated sessions: declarations, samples and queries."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import zenoh

from checks.simulation.hosts.network import SimulatedNetwork
from checks.simulation.hosts.scheduler import Host, Task

if TYPE_CHECKING:
    from checks.simulation.hosts.session import SimulatedSession

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


class SimulatedQuery:
    """Replaces zenoh.Query."""

    def __init__(
        self,
        hub: "SimulatedHub",
        server: Host,
        waiting: PendingQuery,
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
    """Return the part of a key after prefix and robot."""
    path = _PATHS.get(key)
    if path is None:
        path = key.split("/", 2)[2]
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

    def ask(self, asked: SimulatedSample, waiting: PendingQuery, *, has_payload: bool) -> bool:
        """Send a query to its servers; return False when there is none."""
        for tap in self.taps:
            tap(asked.source, asked.key_expr, asked.payload, asked.attachment, True)
        found = self.queryables.met_by(asked.key_expr)
        for one in found:
            query = SimulatedQuery(self, one.host, waiting, asked, has_payload=has_payload)
            path = path_of(asked.key_expr)
            self.network.send(asked.source, one.host, path, one.callback, query)
        return bool(found)
