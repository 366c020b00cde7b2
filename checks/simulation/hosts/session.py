"""A substitute for a Zenoh session, so that the real bus runs on the simulated network.

It offers what the bus uses of Zenoh: publishers, subscribers, queryables, queries and liveliness
tokens.
"""

from collections.abc import Callable
from typing import Any

from checks.simulation.hosts.hub import (
    Delete,
    PendingQuery,
    SimulatedHub,
    SimulatedReply,
    SimulatedSample,
    Subscription,
)
from checks.simulation.hosts.scheduler import current_host, current_task
from runtime.units import NS_PER_S


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

    def declare_link_events_listener(
        self, callback: Callable[[Any], object], *, history: bool
    ) -> None:
        """Call `callback` when the link ends; the processes at its other end have no names here."""
        self._session.watchers.append(callback)


class SimulatedLinkEnd:
    """Replaces zenoh.LinkEvent for a link that has ended."""

    kind = Delete


class SimulatedMatching:
    """Replaces zenoh.MatchingStatus."""

    def __init__(self, matching: bool) -> None:
        self.matching = matching


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
    def matching_status(self) -> SimulatedMatching:
        """The state with regard to subscribers."""
        return SimulatedMatching(bool(self._session.hub.subscribers.met_by(self._key)))

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

    def lose_link(self) -> None:
        """Lose the link."""
        if self.linked:
            self.linked = False
            self._waiting = self.hub.leave(self)
            for watcher in self.watchers:
                self.host.call(watcher, SimulatedLinkEnd())

    def regain_link(self) -> None:
        """Have a link again."""
        if not (self.linked or self._closed):
            self.linked = True
            waiting, self._waiting = self._waiting, []
            self.hub.join(waiting)

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
        *,
        payload: bytes | None = None,
        encoding: object = None,
        timeout: float = 10.0,
        attachment: object = None,
        **_: object,
    ) -> list[SimulatedReply]:
        """Wait for one answer; a reply has no `ok` if none arrives in time."""
        task = current_task()
        waiting = PendingQuery(task)
        note = note_of(attachment)
        words = "" if encoding is None else str(encoding)
        asked = SimulatedSample(str(key), payload or b"", words, note, self.host)
        if not self.linked or not self.hub.ask(asked, waiting, has_payload=payload is not None):
            return []
        scheduler = self.host.scheduler
        deadline_ns = scheduler.now_ns + round(timeout * NS_PER_S)
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
