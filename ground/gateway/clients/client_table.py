"""The clients of all endpoints, and how much of their traffic a round processes."""

from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

from ground.gateway.clients.client_link import GONE_NS, ClientLink
from ground.gateway.clients.framing import Frame
from ground.gateway.endpoints.endpoint import Endpoint, Received

FRAMES_PER_ROUND: Final = 256
"""Received frames of all clients that a round of 20 ms processes; more wait, then are dropped."""
MIN_FRAMES: Final = 8


class Client(NamedTuple):
    """A peer of an endpoint."""

    endpoint: Endpoint
    peer: str
    link: ClientLink
    is_loopback: bool


class Clients:
    """Creates a client for each peer that sends a frame or is connected; drops silent ones."""

    def __init__(
        self,
        endpoints: Sequence[Endpoint],
        join: Callable[[Client], None],
        leave: Callable[[Client], None],
    ) -> None:
        self._endpoints = tuple(endpoints)
        self._join, self._leave = join, leave
        self._known: dict[tuple[Endpoint, str], Client] = {}
        self._numbers = 0

    def __iter__(self) -> Iterator[Client]:
        return iter(list(self._known.values()))

    def __len__(self) -> int:
        return len(self._known)

    def begin_round(self, now_ns: int) -> None:
        """Give each client its share of the round; add connected peers, drop disconnected ones."""
        for endpoint in self._endpoints:
            for peer in endpoint.gone():
                self._drop(endpoint, peer)
            for peer in endpoint.lasting():
                if (endpoint, peer) not in self._known:
                    self._add(self._made(endpoint, peer, now_ns, is_loopback=False))
        for client in self:
            silent = now_ns - client.link.heard_ns >= GONE_NS
            if silent and client.peer not in client.endpoint.lasting():
                self._drop(client.endpoint, client.peer)
                client.endpoint.forget(client.peer)
        share = max(MIN_FRAMES, FRAMES_PER_ROUND // max(1, len(self)))
        for client in self:
            client.link.allow(share)

    def feed(self, endpoint: Endpoint, received: Received, now_ns: int) -> None:
        """Add bytes of a peer. A peer without a connection becomes a client by a valid frame."""
        peer, data, is_loopback = received
        client = self._known.get((endpoint, peer))
        if client is None:
            client = self._made(endpoint, peer, now_ns, is_loopback=is_loopback)
            client.link.allow(MIN_FRAMES)
            client.link.feed(data)
            if peer not in endpoint.lasting() and not client.link.has_frame(now_ns):
                endpoint.forget(peer)
                return
            self._add(client)
        else:
            if client.is_loopback != is_loopback:
                client = client._replace(is_loopback=is_loopback)
                self._known[endpoint, peer] = client
            client.link.feed(data)

    def frames(self, now_ns: int) -> Iterator[tuple[Client, Frame]]:
        """Return the waiting frames of all clients, within their shares."""
        for client in self:
            for frame in client.link.frames(now_ns):
                yield client, frame

    def _made(self, endpoint: Endpoint, peer: str, now_ns: int, *, is_loopback: bool) -> Client:
        return Client(endpoint, peer, ClientLink(self._numbers + 1, peer, now_ns), is_loopback)

    def _add(self, client: Client) -> None:
        self._numbers = client.link.number
        self._known[client.endpoint, client.peer] = client
        self._join(client)

    def _drop(self, endpoint: Endpoint, peer: str) -> None:
        client = self._known.pop((endpoint, peer), None)
        if client is not None:
            self._leave(client)
