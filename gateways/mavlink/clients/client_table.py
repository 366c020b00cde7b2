"""The clients of all endpoints, and how much of their traffic a round processes."""

from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

from gateways.mavlink.clients.client_link import GONE_NS, ClientLink
from gateways.mavlink.clients.framing import (
    MAX_WAITING,
    Frame,
    begins_with_frame,
    is_emergency_stop,
)
from gateways.mavlink.dialect import mavlink
from gateways.mavlink.endpoints.endpoint import MAX_PEERS, Endpoint, Received
from runtime.units import NS_PER_S

FRAMES_PER_ROUND: Final = 256
"""Received frames of all clients that a round of 20 ms processes; more wait, then are dropped."""
MIN_FRAMES: Final = 8
MAX_GUESTS: Final = 8
"""Peers for which there is no place: of these, only the emergency stop is taken. A new one pushes
out the oldest."""
CROWDED_NS: Final = 3 * NS_PER_S
"""A client that is silent for so long loses its place to a new one if all places are taken."""


class Client(NamedTuple):
    """A peer of an endpoint."""

    endpoint: Endpoint
    peer: str
    link: ClientLink
    is_loopback: bool

    @property
    def is_lossy(self) -> bool:
        """Whether the line loses frames; gaps in a sequence on a reliable one are the client's."""
        return self.link.is_lossy and not self.endpoint.is_reliable

    def is_newcomer(self, frame: Frame) -> bool:
        """Return whether a frame comes by TCP before the first HEARTBEAT, and is no emergency stop.

        A program that was never meant to talk to a robot, such as a browser that a web page makes
        send bytes of its choice, thus commands nothing by accident.
        """
        if frame.number == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self.link.is_introduced = True
        is_known = self.link.is_introduced or not self.endpoint.is_reliable
        return not (is_known or is_emergency_stop(frame))


Key = tuple[Endpoint, str]


class Clients:
    """Creates a client for each peer that sends a frame or is connected, and drops the silent.

    Each endpoint has MAX_PEERS places. If all are taken, a new peer gets that of the client which
    has been silent the longest, but never that of one for which `is_owner` returns True. A peer
    without a place is a guest. A TCP connection that does not begin with a frame is closed, and a
    stranger by UDP gets no place by a datagram that does not: a web page can have bytes of its
    choice inside of what a browser sends by itself, such as STUN, but not at the beginning.
    """

    def __init__(
        self,
        endpoints: Sequence[Endpoint],
        join: Callable[[Client], None],
        leave: Callable[[Client], None],
        is_owner: Callable[[Client], bool] = lambda _: False,
    ) -> None:
        self._endpoints = tuple(endpoints)
        self._join, self._leave, self._is_owner = join, leave, is_owner
        self._known: dict[Key, Client] = {}
        self._guests: dict[Key, Client] = {}
        self._unwanted: dict[Key, None] = {}
        self._stops: list[tuple[Client, Frame]] = []
        self._numbers = 0

    def __iter__(self) -> Iterator[Client]:
        return iter(list(self._known.values()))

    def __len__(self) -> int:
        return len(self._known)

    def addressed(self, number: int | None) -> Iterator[Client]:
        """Return all clients for None, otherwise the client or guest with a number."""
        if number is None:
            return iter(self)
        both = (*self._known.values(), *self._guests.values())
        return (client for client in both if client.link.number == number)

    def begin_round(self, now_ns: int) -> None:
        """Give each client its share of the round; add connected peers, drop disconnected ones."""
        for endpoint in self._endpoints:
            for peer in endpoint.gone():
                self._drop((endpoint, peer))
            for peer in list(endpoint.lasting()):
                if (endpoint, peer) not in self._known:
                    self._welcome(endpoint, peer, now_ns)
        for client in (*self._known.values(), *self._guests.values()):
            silent = now_ns - client.link.heard_ns >= GONE_NS
            is_guest = (client.endpoint, client.peer) in self._guests
            if silent and (is_guest or client.peer not in client.endpoint.lasting()):
                self._push_out(client)
        share = max(MIN_FRAMES, FRAMES_PER_ROUND // max(1, len(self)))
        for client in self:
            client.link.allow(share)

    def feed(self, endpoint: Endpoint, received: Received, now_ns: int) -> None:
        """Add bytes of a peer. One without a connection becomes a client if they are a frame."""
        peer, data, is_loopback = received
        key = endpoint, peer
        is_lasting = peer in endpoint.lasting()
        is_invited = is_lasting or begins_with_frame(data)
        table = self._known if key in self._known else self._guests
        client = table.get(key)
        if client is None:
            client = self._made(endpoint, peer, now_ns, is_loopback=is_loopback)
            client.link.allow(MIN_FRAMES)
            client.link.feed(data)
            if is_invited and self._has_place(endpoint, now_ns):
                self._add(client)
            elif is_lasting or client.link.has_frame(now_ns, is_emergency_stop):
                self._add_guest(client)
                self._take_stops(client, now_ns)
            else:
                self._unwanted[key] = None
            return
        if client.is_loopback != is_loopback:
            client = table[key] = client._replace(is_loopback=is_loopback)
        client.link.feed(data)
        if table is self._guests and is_invited and self._has_place(endpoint, now_ns):
            del self._guests[key]
            client.link.allow(MIN_FRAMES)
            self._add(client)
        elif table is self._guests:
            self._take_stops(client, now_ns)

    def frames(self, now_ns: int, *, is_limited: bool = True) -> Iterator[tuple[Client, Frame]]:
        """Return the waiting frames of all clients, within their shares; of guests only stops."""
        for endpoint, peer in self._unwanted:
            if (endpoint, peer) not in self._known and (endpoint, peer) not in self._guests:
                endpoint.forget(peer)
        self._unwanted.clear()
        stops, self._stops = self._stops, []
        yield from stops
        for client in self:
            if not is_limited:
                client.link.allow(MAX_WAITING)
            for frame in client.link.frames(now_ns):
                yield client, frame
            if client.link.is_foreign:
                self._push_out(client)

    def _made(self, endpoint: Endpoint, peer: str, now_ns: int, *, is_loopback: bool) -> Client:
        self._numbers += 1
        link = ClientLink(self._numbers, peer, now_ns, begins=endpoint.is_reliable)
        return Client(endpoint, peer, link, is_loopback)

    def _welcome(self, endpoint: Endpoint, peer: str, now_ns: int) -> None:
        """Add a peer that has connected, as a guest if there is no place."""
        guest = self._guests.get((endpoint, peer))
        client = guest or self._made(endpoint, peer, now_ns, is_loopback=False)
        if self._has_place(endpoint, now_ns):
            self._guests.pop((endpoint, peer), None)
            self._add(client)
        elif guest is None:
            self._add_guest(client)

    def _has_place(self, endpoint: Endpoint, now_ns: int) -> bool:
        """Return whether a client can be added; drop the most silent one if that makes room."""
        there = [client for client in self if client.endpoint is endpoint]
        if len(there) < MAX_PEERS:
            return True
        replaceable = [client for client in there if not self._is_owner(client)]
        if not replaceable:
            return False
        oldest = min(replaceable, key=lambda client: client.link.heard_ns)
        if now_ns - oldest.link.heard_ns < CROWDED_NS:
            return False
        self._push_out(oldest)
        return True

    def _add(self, client: Client) -> None:
        self._known[client.endpoint, client.peer] = client
        self._join(client)

    def _add_guest(self, client: Client) -> None:
        if len(self._guests) >= MAX_GUESTS:
            self._push_out(next(iter(self._guests.values())))
        self._guests[client.endpoint, client.peer] = client

    def _take_stops(self, client: Client, now_ns: int) -> None:
        """Take the emergency stops of a guest now, before others push it out."""
        client.link.allow(MIN_FRAMES)
        frames = client.link.frames(now_ns)
        self._stops += [(client, frame) for frame in frames if is_emergency_stop(frame)]
        if client.link.is_foreign:
            self._push_out(client)

    def _push_out(self, client: Client) -> None:
        self._drop((client.endpoint, client.peer))
        client.endpoint.forget(client.peer)

    def _drop(self, key: Key) -> None:
        client = self._known.pop(key, None) or self._guests.pop(key, None)
        if client is not None:
            self._leave(client)
