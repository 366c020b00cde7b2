"""What the simulated sessions of one run share: declarations, samples and queries on their way."""

from collections.abc import Callable
from typing import Any, Final

import zenoh

from verification.simulation.hosts.network import Network
from verification.simulation.hosts.scheduler import Host, Task

WATCHED: Final = ("drive/", "sense/", "op/", "srv/")
"""Beginnings of the topics and services that invariants or the attacker look at."""

MANY: Final = 10_000
Tap = Callable[[Host, str, bytes, bytes | None, bool], None]

Put: Final = zenoh.SampleKind.PUT
Delete: Final = zenoh.SampleKind.DELETE


class Payload(bytes):
    """As zenoh.ZBytes."""

    __slots__ = ()

    def to_bytes(self) -> bytes:
        return self


class Sample:
    """As zenoh.Sample."""

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
        self.payload = Payload(payload)
        self.encoding = encoding
        self.attachment = None if attachment is None else Payload(attachment)
        self.kind = kind
        self.source = source
        self.sent_ns = source.scheduler.now_ns
        self.timestamp = None


class Reply:
    """As zenoh.Reply: `ok` is None where no answer has come in time."""

    __slots__ = ("err", "ok")

    def __init__(self, ok: Sample | None) -> None:
        self.ok = ok
        self.err = None


class Waiting:
    """A query that is not answered yet."""

    __slots__ = ("dropped", "replies", "task")

    def __init__(self, task: Task) -> None:
        self.task = task
        self.replies: list[Reply] = []
        self.dropped = False

    def answered(self, sample: Sample) -> None:
        self.replies.append(Reply(sample))
        self.task.wake()

    def drop(self) -> None:
        self.dropped = True
        self.task.wake()


class Query:
    """As zenoh.Query."""

    def __init__(
        self,
        hub: "Hub",
        server: Host,
        waiting: Waiting,
        asked: Sample,
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

    def __enter__(self) -> "Query":
        return self

    def __exit__(self, *_: object) -> None:
        """Replies of the simulation are final at once."""

    def reply(self, key: object, payload: bytes, *, encoding: object = "", **_: object) -> None:
        sample = Sample(str(key), payload, str(encoding), None, self._server)
        self._back(self._waiting.answered, sample)

    def reply_err(self, payload: object, **_: object) -> None:
        self._back(self._waiting.drop)

    def drop(self) -> None:
        self._back(self._waiting.drop)

    def _back(self, action: Callable[..., object], *arguments: Any) -> None:
        if self._server.alive:
            source, path = self._asked.source, path_of(self.key_expr)
            self._hub.network.send(self._server, source, path, action, *arguments)


class Subscription:
    """A subscriber, queryable or liveliness token; undeclare it to end it."""

    __slots__ = ("callback", "host", "key", "table")

    def __init__(
        self, key: str, host: Host, callback: Callable[[Any], object], table: "Table"
    ) -> None:
        self.key = key
        self.host = host
        self.callback = callback
        self.table = table

    def undeclare(self) -> None:
        self.table.remove(self)


class Table:
    """Declarations by key expression, and which of them a key meets."""

    def __init__(self) -> None:
        self._all: list[Subscription] = []
        self._routes: dict[str, tuple[Subscription, ...]] = {}
        self.quiet: dict[str, bool] = {}
        """Keys that nobody looks at, for as long as the declarations are what they are."""

    def add(self, one: Subscription) -> Subscription:
        self._all.append(one)
        self._routes.clear()
        self.quiet.clear()
        return one

    def remove(self, one: Subscription) -> None:
        if one in self._all:
            self._all.remove(one)
            self._routes.clear()
            self.quiet.clear()

    def leave(self, host: Host) -> list[Subscription]:
        """Remove all of a host that has ended; what they were."""
        gone = [one for one in self._all if one.host is host]
        self._all = [one for one in self._all if one.host is not host]
        self._routes.clear()
        self.quiet.clear()
        return gone

    def met_by(self, key: str) -> tuple[Subscription, ...]:
        found = self._routes.get(key)
        if found is None:
            found = tuple(one for one in self._all if intersects(one.key, key))
            self._routes[key] = found
        return found


_INTERSECTS: dict[tuple[str, str], bool] = {}


def intersects(one: str, other: str) -> bool:
    """Whether two key expressions meet, as Zenoh decides it."""
    found = _INTERSECTS.get((one, other))
    if found is None:
        found = _INTERSECTS[one, other] = zenoh.KeyExpr(one).intersects(zenoh.KeyExpr(other))
    return found


_PATHS: dict[str, str] = {}


def path_of(key: str) -> str:
    """What follows prefix and robot in a key."""
    path = _PATHS.get(key)
    if path is None:
        path = key.split("/", 2)[2]
        if len(_PATHS) < MANY:
            _PATHS[key] = path
    return path


class Hub:
    """What all sessions of one simulation share."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.subscribers = Table()
        self.queryables = Table()
        self.tokens = Table()
        self.watchers = Table()
        self.taps: list[Tap] = []
        """Called with each frame that is put or asked: source, key, payload, attachment, asked."""
        self.arrivals: list[Callable[[Sample], None]] = []
        """Called with each sample of an operator that arrives at the robot, before it is heard."""

    def heard(self, callback: Callable[[Any], object]) -> Callable[[Any], object]:
        """A callback that tells of what arrives, and then takes it."""

        def take(sample: Sample) -> None:
            for tap in self.arrivals:
                tap(sample)
            callback(sample)

        return take

    def leave(self, host: Host) -> None:
        """A host has ended: its declarations end, and others learn it."""
        self.subscribers.leave(host)
        self.queryables.leave(host)
        self.watchers.leave(host)
        for token in self.tokens.leave(host):
            self.tell(token, Delete)

    def tell(self, token: Subscription, kind: object) -> None:
        """Tell those that watch that a token has come or gone."""
        for watcher in self.watchers.met_by(token.key):
            sample = Sample(token.key, b"", "", None, token.host, kind)
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
        network, sample = self.network, Sample(key, frame, encoding, note, source)
        for one in found:
            network.send(source, one.host, path, one.callback, sample)

    def quiet(self, key: str) -> bool:
        """Whether nobody looks at what is put on a key."""
        found = self.subscribers.quiet.get(key)
        if found is None:
            listened = self.subscribers.met_by(key) or path_of(key).startswith(WATCHED)
            found = self.subscribers.quiet[key] = not listened
        return found

    def ask(self, asked: Sample, waiting: Waiting, *, has_payload: bool) -> bool:
        """Send a query to its servers; False when there is none."""
        for tap in self.taps:
            tap(asked.source, asked.key_expr, asked.payload, asked.attachment, True)
        found = self.queryables.met_by(asked.key_expr)
        for one in found:
            query = Query(self, one.host, waiting, asked, has_payload=has_payload)
            path = path_of(asked.key_expr)
            self.network.send(asked.source, one.host, path, one.callback, query)
        return bool(found)
