"""The clients of all endpoints: their frames in both directions, counters, and the list of them.

A round processes only so much of their traffic.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, NamedTuple

from gateways.mavlink.endpoints import MAX_PEERS, Endpoint
from gateways.mavlink.framing import (
    MAX_WAITING,
    Deframer,
    MavFrame,
    begins_with_frame,
    is_emergency_stop,
)
from gateways.mavlink.mav_service import COMPONENT, MAVLINK_1_LAST
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.signing import Counters, SigningGuard
from runtime.units import NS_PER_S

GONE_NS: Final = 10_000_000_000
RADIOS: Final = (mavlink.MAVLINK_MSG_ID_RADIO_STATUS, mavlink.MAVLINK_MSG_ID_RADIO)
"""A telemetry radio injects these by itself, in MAVLink 1."""
MAX_SOURCES: Final = 32
"""Senders behind one client whose sequences are followed."""
LATE: Final = 0xF0
"""A sequence number so far ahead is rather some behind: the frame was overtaken, or is a copy."""
LOSSY_SHARE: Final = 0.05
FADING: Final = 0.97
"""The weight that older frames lose with each new one; about the last 30 decide."""


class ClientLink:
    """Frames from and to one client.

    Each vehicle has its own sequence numbers, so they have no gaps. With `begins` what it sends has
    to begin with a frame. `is_mavlink1` is the version in which it gets answers: that of its ground
    station, or of all that it sends while none is known. Version 2 stays once it was received.
    """

    def __init__(self, number: int, name: str, now_ns: int, *, begins: bool = False) -> None:
        self.number = number
        self.name = name
        self.heard_ns = now_ns
        self.received = self.sent = self.lost = 0
        self.is_mavlink1 = self.is_introduced = False
        self._keeps_mavlink2 = False
        self._stations: set[tuple[int, int]] = set()
        self.signing = Counters()
        self._deframer = Deframer(begins=begins)
        self._ready: list[MavFrame] = []
        self._decoder = mavlink.MAVLink(None)
        self._encoders: dict[int, Any] = {}
        self._sequences: dict[tuple[int, int], int] = {}
        self._recently_lost = self._recent = 0.0

    @property
    def is_lossy(self) -> bool:
        """Whether the line has lost a notable share of the newest frames from the client."""
        return self._recently_lost > LOSSY_SHARE * self._recent

    @property
    def malformed(self) -> int:
        """The number of byte sequences that were no frame, or a frame of an unknown message."""
        return self._deframer.malformed + self._deframer.unknown

    @property
    def is_foreign(self) -> bool:
        """Whether the first bytes were no frame: another program than a MAVLink client."""
        return self._deframer.is_foreign

    @property
    def dropped(self) -> int:
        """The number of received bytes that were dropped because the buffer was full."""
        return self._deframer.dropped

    def feed(self, data: bytes) -> None:
        """Add received bytes."""
        self._deframer.feed(data)

    def has_frame(self, now_ns: int, accepts: Callable[[MavFrame], bool] = lambda _: True) -> bool:
        """Return whether such a frame is among the received bytes; it stays for `frames`."""
        self._ready += self._deframer.take(now_ns)
        return any(accepts(frame) for frame in self._ready)

    def allow(self, frames: int) -> None:
        """Permit this many frames until the next call."""
        self._deframer.allowance = frames

    def frames(self, now_ns: int) -> list[MavFrame]:
        """Return the waiting frames, at most as many as permitted."""
        ready, self._ready = self._ready, []
        found = ready + self._deframer.take(now_ns)
        for frame in found:
            self._count(frame)
            self.heard_ns = now_ns
        return found

    def decode(self, frame: MavFrame) -> MavMessage | None:
        """Return the message in a frame, and note its version."""
        try:
            message = self._decoder.decode(bytearray(frame.data))
        except mavlink.MAVError:
            self._deframer.malformed += 1
            return None
        if frame.number not in RADIOS:
            self._note_version(frame, message)
        return message

    def _note_version(self, frame: MavFrame, message: MavMessage) -> None:
        source = frame.system, frame.component
        is_beat = frame.number == mavlink.MAVLINK_MSG_ID_HEARTBEAT
        if is_beat and message.type == mavlink.MAV_TYPE_GCS and source not in self._stations:
            self._keeps_mavlink2 &= bool(self._stations)
            if len(self._stations) < MAX_SOURCES:
                self._stations.add(source)
        if not self._stations or source in self._stations:
            self._keeps_mavlink2 |= not frame.is_mavlink1 or bool(self.signing.signed)
            self.is_mavlink1 = not self._keeps_mavlink2

    def encode(self, system: int, message: MavMessage, guard: SigningGuard) -> bytes:
        """Return the next frame of a vehicle; empty if MAVLink 1 cannot carry the message."""
        if self.is_mavlink1 and message.get_msgId() > MAVLINK_1_LAST:
            return b""
        encoder = self._encoders.get(system)
        if encoder is None:
            encoder = self._encoders[system] = mavlink.MAVLink(None, system, COMPONENT)
        guard.prepare(encoder)
        frame: bytes = message.pack(encoder, force_mavlink1=self.is_mavlink1)
        encoder.seq = (encoder.seq + 1) & 0xFF
        self.sent += 1
        return frame

    def _count(self, frame: MavFrame) -> None:
        self.received += 1
        source = (frame.system, frame.component)
        expected = self._sequences.get(source)
        if expected is None and len(self._sequences) >= MAX_SOURCES:
            return
        gap = 0 if expected is None else (frame.sequence - expected) & 0xFF
        if gap >= LATE:  # it was counted as lost
            gap = -1 if self.lost else 0
        else:
            self._sequences[source] = (frame.sequence + 1) & 0xFF
        self.lost += gap
        self._recently_lost = max(0.0, FADING * self._recently_lost + gap)
        self._recent = FADING * self._recent + 1 + gap


FRAMES_PER_ROUND: Final = 256
"""Received frames of all clients that a round of 20 ms processes; more wait, then are dropped."""
MIN_FRAMES: Final = 8
MAX_GUESTS: Final = 8
"""Peers for which there is no place: of these, only the emergency stop is taken. A new one pushes
out the oldest."""
CROWDED_NS: Final = 3 * NS_PER_S
"""A client that is silent for so long loses its place to a new one if all places are taken."""


class GatewayClient(NamedTuple):
    """A peer of an endpoint."""

    endpoint: Endpoint
    peer: str
    link: ClientLink
    is_loopback: bool

    @property
    def is_lossy(self) -> bool:
        """Whether the line loses frames; gaps in a sequence on a reliable one are the client's."""
        return self.link.is_lossy and not self.endpoint.is_reliable

    def is_newcomer(self, frame: MavFrame) -> bool:
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
        join: Callable[[GatewayClient], None],
        leave: Callable[[GatewayClient], None],
        is_owner: Callable[[GatewayClient], bool] = lambda _: False,
    ) -> None:
        self._join, self._leave, self._is_owner = join, leave, is_owner
        self._known: dict[Key, GatewayClient] = {}
        self._guests: dict[Key, GatewayClient] = {}
        self._keys: dict[int, Key] = {}
        """Those of both, by the numbers of their links."""
        self._connected: dict[Key, None] = {}
        self._unread: dict[Key, None] = {}
        self._unwanted: dict[Key, None] = {}
        self._stops: list[tuple[GatewayClient, MavFrame]] = []
        self._numbers = 0

    def __iter__(self) -> Iterator[GatewayClient]:
        return iter(list(self._known.values()))

    def __len__(self) -> int:
        return len(self._known)

    def addressed(self, number: int | None) -> Sequence[GatewayClient]:
        """Return all clients for None, otherwise the client or guest with a number."""
        if number is None:
            return tuple(self._known.values())
        key = self._keys.get(number)
        client = None if key is None else self._known.get(key) or self._guests.get(key)
        return () if client is None else (client,)

    def connect(self, endpoint: Endpoint, peer: str, now_ns: int) -> None:
        """Add a peer that stays while it is silent: a connection or a line."""
        self._connected[endpoint, peer] = None
        self._welcome(endpoint, peer, now_ns)

    def disconnect(self, endpoint: Endpoint, peer: str) -> None:
        """Drop a peer whose connection or line has ended."""
        self._connected.pop((endpoint, peer), None)
        self._drop((endpoint, peer))

    def begin_round(self, now_ns: int) -> None:
        """Give each client its share of the round; add connected peers, drop silent ones."""
        for endpoint, peer in list(self._connected):
            if (endpoint, peer) not in self._known:
                self._welcome(endpoint, peer, now_ns)
        for client in (*self._known.values(), *self._guests.values()):
            silent = now_ns - client.link.heard_ns >= GONE_NS
            key = client.endpoint, client.peer
            if silent and (key in self._guests or key not in self._connected):
                self._push_out(client)
        share = max(MIN_FRAMES, FRAMES_PER_ROUND // max(1, len(self)))
        for client in self:
            client.link.allow(share)
        self._unread = dict.fromkeys(self._known)

    def feed(
        self, endpoint: Endpoint, peer: str, data: bytes, now_ns: int, *, is_loopback: bool
    ) -> None:
        """Add bytes of a peer. One without a connection becomes a client if they are a frame."""
        key = endpoint, peer
        is_lasting = key in self._connected
        self._unread[key] = None
        table = self._known if key in self._known else self._guests
        is_invited = is_lasting or (table is self._guests and begins_with_frame(data))
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

    def frames(
        self, now_ns: int, *, is_limited: bool = True
    ) -> Iterator[tuple[GatewayClient, MavFrame]]:
        """Return the frames that have arrived since the last call, within the clients' shares.

        The rest waits for the next round. Of guests only emergency stops are returned.
        """
        for endpoint, peer in self._unwanted:
            if (endpoint, peer) not in self._known and (endpoint, peer) not in self._guests:
                endpoint.forget(peer)
        self._unwanted.clear()
        stops, self._stops = self._stops, []
        yield from stops
        unread, self._unread = self._unread, {}
        for client in [self._known[key] for key in unread if key in self._known]:
            if not is_limited:
                client.link.allow(MAX_WAITING)
            for frame in client.link.frames(now_ns):
                yield client, frame
            if client.link.is_foreign:
                self._push_out(client)

    def _made(
        self, endpoint: Endpoint, peer: str, now_ns: int, *, is_loopback: bool
    ) -> GatewayClient:
        self._numbers += 1
        link = ClientLink(self._numbers, peer, now_ns, begins=endpoint.is_reliable)
        return GatewayClient(endpoint, peer, link, is_loopback)

    def _welcome(self, endpoint: Endpoint, peer: str, now_ns: int) -> None:
        """Add a peer that has connected, as a guest if there is no place."""
        guest = self._guests.get((endpoint, peer))
        client = guest or self._made(endpoint, peer, now_ns, is_loopback=False)
        client.link.allow(MIN_FRAMES)
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

    def _add(self, client: GatewayClient) -> None:
        key = self._keys[client.link.number] = client.endpoint, client.peer
        self._known[key] = client
        self._join(client)

    def _add_guest(self, client: GatewayClient) -> None:
        if len(self._guests) >= MAX_GUESTS:
            self._push_out(next(iter(self._guests.values())))
        key = self._keys[client.link.number] = client.endpoint, client.peer
        self._guests[key] = client

    def _take_stops(self, client: GatewayClient, now_ns: int) -> None:
        """Take the emergency stops of a guest now, before others push it out."""
        client.link.allow(MIN_FRAMES)
        frames = client.link.frames(now_ns)
        self._stops += [(client, frame) for frame in frames if is_emergency_stop(frame)]
        if client.link.is_foreign:
            self._push_out(client)

    def _push_out(self, client: GatewayClient) -> None:
        self._drop((client.endpoint, client.peer))
        client.endpoint.forget(client.peer)

    def _drop(self, key: Key) -> None:
        client = self._known.pop(key, None) or self._guests.pop(key, None)
        if client is not None:
            del self._keys[client.link.number]
            self._leave(client)
