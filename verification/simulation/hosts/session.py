"""A stand-in for a Zenoh session, so that the real bus runs on the simulated network.

It has what the bus uses of Zenoh: publishers, subscribers, queryables, queries, liveliness tokens.
"""

from collections.abc import Callable
from typing import Any

from runtime.units import NS_PER_S
from verification.simulation.hosts.hub import Hub, Put, Reply, Sample, Subscription, Waiting
from verification.simulation.hosts.scheduler import current_host, current_task


class Info:
    """As zenoh.SessionInfo."""

    def __init__(self, peers: list[str]) -> None:
        self._peers = peers

    def routers_zid(self) -> list[str]:
        return []

    def peers_zid(self) -> list[str]:
        return self._peers

    def declare_link_events_listener(self, _callback: object, *, history: bool) -> None:
        """There are no links here whose coming could be told."""


class Matching:
    """As zenoh.MatchingStatus."""

    def __init__(self, matching: bool) -> None:
        self.matching = matching


class Publisher:
    """As zenoh.Publisher."""

    def __init__(self, session: "Session", key: str, encoding: str) -> None:
        self._session = session
        self._key = key
        self._encoding = encoding

    def put(self, payload: bytes, *, attachment: object = None, **_: object) -> None:
        session = self._session
        session.hub.put(session.host, self._key, payload, self._encoding, note_of(attachment))

    @property
    def quiet(self) -> bool:
        return self._session.hub.quiet(self._key)

    @property
    def matching_status(self) -> Matching:
        return Matching(bool(self._session.hub.subscribers.met_by(self._key)))

    def undeclare(self) -> None:
        """Nothing is kept of it."""


class Liveliness:
    """As zenoh.Liveliness."""

    def __init__(self, session: "Session") -> None:
        self._session = session

    def declare_token(self, key: str) -> Subscription:
        hub, host = self._session.hub, self._session.host
        token = hub.tokens.add(Subscription(key, host, lambda _: None, hub.tokens))
        hub.tell(token, Put)
        return token

    def get(self, key: str, **_: object) -> list[Reply]:
        hub, host = self._session.hub, self._session.host
        found = hub.tokens.met_by(key)
        here = [one for one in found if one.host is host or hub.network.connected(one.host, host)]
        return [Reply(Sample(one.key, b"", "", None, one.host)) for one in here]

    def declare_subscriber(
        self, key: str, callback: Callable[[Any], object], *, history: bool = False
    ) -> Subscription:
        hub, host = self._session.hub, self._session.host
        watcher = hub.watchers.add(Subscription(key, host, callback, hub.watchers))
        if history:
            for reply in self.get(key):
                callback(reply.ok)
        return watcher


class Session:
    """As zenoh.Session, of the host that opens it."""

    def __init__(self, hub: Hub, zid: str) -> None:
        self.hub = hub
        self.host = current_host()
        self._zid = zid

    def zid(self) -> str:
        return self._zid

    @property
    def info(self) -> Info:
        """Peers are linked while the robot's host is there: it is the hub of the topology."""
        network = self.hub.network
        robots = [one.host for one in self.hub.tokens.met_by("sidestep/*/alive/robot/*")]
        linked = [host.name for host in robots if network.connected(host, self.host)]
        return Info(linked)

    def declare_publisher(self, key: str, *, encoding: object = "", **_: object) -> Publisher:
        return Publisher(self, str(key), str(encoding))

    def declare_subscriber(self, key: str, callback: Callable[[Any], object]) -> Subscription:
        table = self.hub.subscribers
        if self.host.name == "robot" and "/op/" in str(key):
            callback = self.hub.heard(callback)
        return table.add(Subscription(str(key), self.host, callback, table))

    def declare_queryable(
        self, key: str, callback: Callable[[Any], object], **_: object
    ) -> Subscription:
        table = self.hub.queryables
        return table.add(Subscription(str(key), self.host, callback, table))

    def liveliness(self) -> Liveliness:
        return Liveliness(self)

    def new_timestamp(self) -> None:
        return None

    def put(
        self,
        key: str,
        payload: bytes,
        *,
        encoding: object = "",
        attachment: object = None,
        **_: object,
    ) -> None:
        self.hub.put(self.host, str(key), payload, str(encoding), note_of(attachment))

    def get(
        self,
        key: str,
        *,
        payload: bytes | None = None,
        encoding: object = None,
        timeout: float = 10.0,
        attachment: object = None,
        **_: object,
    ) -> list[Reply]:
        """Wait for one answer; a reply without `ok` when none has come in time."""
        task = current_task()
        waiting = Waiting(task)
        note = note_of(attachment)
        words = "" if encoding is None else str(encoding)
        asked = Sample(str(key), payload or b"", words, note, self.host)
        if not self.hub.ask(asked, waiting, has_payload=payload is not None):
            return []
        scheduler = self.host.scheduler
        deadline_ns = scheduler.now_ns + round(timeout * NS_PER_S)
        while not waiting.replies and not waiting.dropped and scheduler.now_ns < deadline_ns:
            task.wait_until(deadline_ns)
        return waiting.replies or ([] if waiting.dropped else [Reply(None)])

    def close(self) -> None:
        self.hub.leave(self.host)


def note_of(attachment: object) -> bytes | None:
    """The bytes of an attachment."""
    if attachment is None:
        return None
    return attachment.encode() if isinstance(attachment, str) else bytes(attachment)  # type: ignore[call-overload]
