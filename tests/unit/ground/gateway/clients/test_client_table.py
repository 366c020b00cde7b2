"""The loop with fake endpoints: clients come and go, and no flood holds up a round."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import cast

import pytest

from gateways.mavlink.clients import (
    CROWDED_NS,
    FRAMES_PER_ROUND,
    GONE_NS,
    MAX_GUESTS,
    ClientLink,
    Clients,
    GatewayClient,
)
from gateways.mavlink.endpoints import MAX_PEERS, ReceivedBytes
from gateways.mavlink.framing import is_emergency_stop
from gateways.mavlink.mavlink_dialect import mavlink
from tests.support.each import each
from tests.unit.ground.gateway.clients.test_framing import packed


class FakeEndpoint:
    text, line_bytes_s = "fake", None

    def __init__(self) -> None:
        self.is_reliable = False
        self.connected: list[str] = []
        self.ended: list[str] = []
        self.forgotten: list[str] = []

    def filenos(self) -> list[int]:
        return []

    def lasting(self) -> list[str]:
        return self.connected

    def gone(self) -> list[str]:
        ended, self.ended = self.ended, []
        return ended

    def receive(self) -> list[ReceivedBytes]:
        return []

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None: ...

    def flush(self, now_ns: int) -> None: ...

    def forget(self, peer: str) -> None:
        self.forgotten.append(peer)

    def close(self) -> None: ...


class Room:
    def __init__(self) -> None:
        self.endpoint = FakeEndpoint()
        self.log: list[tuple[str, int]] = []
        self.owner = 0
        self.clients = Clients(
            [self.endpoint],
            self._note("join"),
            self._note("leave"),
            lambda client: client.link.number == self.owner,
        )

    def _note(self, word: str) -> "Note":
        return Note(self.log, word)

    def feed(self, peer: str, data: bytes, now_ns: int = 0) -> None:
        self.clients.feed(self.endpoint, ReceivedBytes(peer, data, True), now_ns)

    def fill(self, now_ns: int = 0) -> None:
        """Give all places away."""
        for number in range(MAX_PEERS):
            self.feed(f"old {number}", packed(), now_ns)
        list(self.frames(now_ns))

    def peers(self) -> list[str]:
        return [client.peer for client in self.clients]

    def frames(self, now_ns: int = 0) -> Iterator[GatewayClient]:
        for client, _ in self.clients.frames(now_ns):
            yield client


class Note:
    def __init__(self, log: list[tuple[str, int]], word: str) -> None:
        self._log, self._word = log, word

    def __call__(self, client: GatewayClient) -> None:
        self._log.append((self._word, client.link.number))


@pytest.fixture
def room() -> Room:
    return Room()


def test_sender_of_a_frame_becomes_a_client(room: Room) -> None:
    room.feed("a", packed())
    room.feed("b", packed(mavlink1=True))
    assert room.log == [("join", 1), ("join", 2)]
    assert [client.peer for client in room.frames()] == ["a", "b"]


def test_sender_of_rubbish_takes_no_place(room: Room) -> None:
    room.feed("a", b"\xfd rubbish" * 9)
    assert list(room.frames()) == []
    assert room.log == []
    assert room.endpoint.forgotten == ["a"]


def test_silent_sender_is_dropped_but_not_a_connection(room: Room) -> None:
    room.endpoint.connected.append("line")
    room.clients.begin_round(0)
    room.feed("a", packed())
    assert len(list(room.frames())) == 1
    room.clients.begin_round(GONE_NS - 1)
    assert room.log == [("join", 1), ("join", 2)]
    room.clients.begin_round(GONE_NS)
    assert room.log[2:] == [("leave", 2)]
    room.endpoint.connected.clear()
    room.endpoint.ended.append("line")
    room.clients.begin_round(GONE_NS)
    assert room.log[3:] == [("leave", 1)]


@pytest.mark.parametrize("is_guest", [False, True])
@each(
    "begins",
    [
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1:5760\r\n\r\n",
        b"GET /chat HTTP/1.1\r\nUpgrade: websocket\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        packed()[:-1] + b"!",
        b"\0",
    ],
)
def test_tcp_connection_that_begins_with_no_frame_is_closed(begins: bytes, is_guest: bool) -> None:
    room = Room()
    room.endpoint.is_reliable = True
    if is_guest:
        room.fill()
    room.endpoint.connected.append("web")
    room.clients.begin_round(0)
    room.feed("web", begins + packed(STOP) + packed())
    assert list(room.frames()) == []
    assert room.endpoint.forgotten == ["web"]
    assert "web" not in room.peers()


def test_false_bytes_after_the_first_frame_close_no_tcp_connection(room: Room) -> None:
    room.endpoint.is_reliable = True
    room.endpoint.connected.append("line")
    room.clients.begin_round(0)
    for data in (packed()[:5], packed()[5:] + b"POST / HTTP/1.1\r\n\r\n", packed(STOP)):
        room.feed("line", data)
        list(room.frames())
    room.feed("line", b"\xfd rubbish" + packed())
    assert len(list(room.frames())) == 1
    assert room.endpoint.forgotten == []


STUN = bytes.fromhex("000300b82112a442") + b"transaction!" + b"\0\x14\0\x50"
"""How a browser's request to a TURN server begins, up to a realm of 80 bytes. Another TURN server
can choose these bytes and the address that they are sent to, as Chromium 156 was seen to do."""
QUIC = b"\xc3\0\0\0\1\x08destined\0\x40\x50"
"""How it begins a connection by QUIC, up to a token of 80 bytes that a server has chosen."""


@each("begins", [STUN, QUIC, b"\x16\xfe\xfd\0", b"\0", packed()[:-1], b"\xfd\0"])
def test_stranger_by_udp_whose_datagram_is_no_frame_only_stops(begins: bytes) -> None:
    room = Room()
    for _ in range(3):
        room.feed("web", begins + packed() + packed(ARM) + packed(CLEAR))
        assert list(room.frames()) == []
    assert room.log == []
    assert room.endpoint.forgotten == ["web"] * 3
    for _ in range(2):  # also as a guest
        room.feed("web", begins + packed(ARM) + packed(STOP) + packed(CLEAR))
        ((client, frame),) = room.clients.frames(0)
        assert client.peer == "web"
        assert is_emergency_stop(frame)
        assert room.peers() == []
    room.feed("web", packed(ARM) + begins + packed(CLEAR))
    assert room.peers() == ["web"]


def test_where_the_gateway_dials_or_has_a_line_it_joins_in_mid_frame(room: Room) -> None:
    room.endpoint.connected.append("line")
    room.clients.begin_round(0)
    room.feed("line", packed()[5:] + packed() + packed(ARM))
    assert len(list(room.frames())) == 2


def test_flood_of_one_client_leaves_others_their_share(room: Room) -> None:
    room.feed("a", packed())
    room.feed("b", packed())
    list(room.frames())
    room.feed("a", packed() * 10_000)
    room.feed("b", packed())
    room.clients.begin_round(1)
    peers = [client.peer for client in room.frames(1)]
    assert peers.count("b") == 1
    assert peers.count("a") <= FRAMES_PER_ROUND // 2
    assert next(iter(room.clients)).link.dropped > 0


STOP = mavlink.MAVLink_command_long_message(0, 0, 185, 0, 1, 0, 0, 0, 0, 0, 0)
STOP_INT = mavlink.MAVLink_command_int_message(0, 0, 0, 185, 0, 0, 1, 0, 0, 0, 0, 0, 0)
CLEAR = mavlink.MAVLink_command_long_message(1, 1, 185, 0, 0, 0, 0, 0, 0, 0, 0)
ARM = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


def test_new_client_gets_the_place_of_the_most_silent(room: Room) -> None:
    room.fill()
    for number in range(1, MAX_PEERS):
        room.feed(f"old {number}", packed(), number)
    list(room.frames(MAX_PEERS))
    room.feed("new", packed(), CROWDED_NS - 1)
    assert "new" not in room.peers()
    room.feed("new", packed(), CROWDED_NS)
    assert "new" in room.peers()
    assert "old 0" not in room.peers()
    assert "old 0" in room.endpoint.forgotten


def test_owner_is_never_pushed_out(room: Room) -> None:
    room.fill()
    room.owner = 1
    for number in range(500):
        now_ns = CROWDED_NS + number * CROWDED_NS // 100
        room.feed(f"flood {number}", packed(), now_ns)
        list(room.frames(now_ns))
        assert "old 0" in room.peers()
        assert len(room.peers()) <= MAX_PEERS


@pytest.mark.parametrize("mavlink1", [False, True])
@pytest.mark.parametrize("stop", [STOP, STOP_INT])
def test_client_without_a_place_may_stop_the_robot(
    room: Room, stop: object, mavlink1: bool
) -> None:
    room.fill()
    for message in (ARM, CLEAR, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)):
        room.feed("new", packed(message))
    assert list(room.frames()) == []
    room.feed("new", packed(stop, mavlink1=mavlink1) + packed(ARM))
    (client,) = room.frames()
    assert client.peer == "new"
    assert list(room.clients.addressed(client.link.number)) == [client]
    assert "new" not in [one.peer for one in room.clients.addressed(None)]
    room.feed("new", packed(CLEAR) + packed(stop))
    assert len(list(room.frames())) == 1
    room.clients.begin_round(GONE_NS)
    assert ("leave", client.link.number) in room.log
    assert "new" in room.endpoint.forgotten


def test_guest_becomes_a_client_when_a_place_is_free(room: Room) -> None:
    room.fill()
    room.feed("new", packed(STOP))
    (guest,) = room.frames()
    room.feed("new", packed(), CROWDED_NS)
    assert [client.peer for client in room.frames(CROWDED_NS)] == ["new"]
    assert room.log[-1] == ("join", guest.link.number)
    assert not room.clients._guests


def test_connections_without_a_place_wait_as_guests(room: Room) -> None:
    room.endpoint.connected = [f"tcp {number}" for number in range(MAX_PEERS + MAX_GUESTS + 1)]
    room.clients.begin_round(0)
    assert room.peers() == room.endpoint.connected[:MAX_PEERS]
    assert room.endpoint.forgotten == [f"tcp {MAX_PEERS}"]
    last = room.endpoint.connected[-1]
    room.feed(last, packed() + packed(STOP))
    assert [client.peer for client in room.frames()] == [last]
    room.endpoint.connected = [*room.endpoint.connected[1:MAX_PEERS], last]
    room.endpoint.ended = ["tcp 0"]
    room.clients.begin_round(1)
    assert last in room.peers()


def test_flood_of_joins_costs_no_memory(room: Room) -> None:
    room.fill()
    for number in range(3_000):
        room.feed(f"flood {number}", packed(STOP if number % 2 else ARM))
    assert len(list(room.frames())) == 1_500
    assert len(room.clients._guests) == MAX_GUESTS
    assert len(room.clients) == MAX_PEERS
    assert len(room.endpoint.forgotten) == 3_000 - MAX_GUESTS
    assert not room.clients._unwanted


@each("is_reliable", [False, True])
def test_gaps_are_losses_unless_the_line_is_reliable(*, is_reliable: bool) -> None:
    endpoint, link = FakeEndpoint(), cast("ClientLink", SimpleNamespace(is_lossy=True))
    endpoint.is_reliable = is_reliable
    assert GatewayClient(endpoint, "peer", link, True).is_lossy is not is_reliable
