"""Clients of the gateway: they come and go, their frames, and the report on each."""

from collections.abc import Iterator
from random import Random
from types import SimpleNamespace
from typing import cast

import pytest
from pymavlink.dialects.v20 import common, development

from checks.harness.played_gateway import PlayedEndpoint
from gateways.mavlink.clients import (
    CROWDED_NS,
    FRAMES_PER_ROUND,
    GONE_NS,
    MAX_GUESTS,
    ClientLink,
    Clients,
    GatewayClient,
)
from gateways.mavlink.endpoints import MAX_PEERS
from gateways.mavlink.framing import (
    MAX_WAITING,
    UNFINISHED_NS,
    Deframer,
    MavFrame,
    is_emergency_stop,
)
from gateways.mavlink.gateway import Reporter
from gateways.mavlink.mavlink_dialect import (
    AvailableModes,
    ComponentMetadata,
    ControlStatus,
    CurrentMode,
    MavMessage,
    MissionAck,
    MissionCount,
    MissionCurrent,
    mavlink,
)
from gateways.mavlink.operator_control import Owner
from gateways.mavlink.signing import SigningGuard
from runtime.units import NS_PER_S
from tests.support.each import each

HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def packed(message: object = HEARTBEAT, *, mavlink1: bool = False, sequence: int = 0) -> bytes:
    encoder = mavlink.MAVLink(None, 255, 190)
    encoder.seq = sequence
    found: bytes = message.pack(encoder, force_mavlink1=mavlink1)  # type: ignore[attr-defined]
    return found


def taken(deframer: Deframer, data: bytes, now_ns: int = 0) -> list[MavFrame]:
    deframer.allowance = 100_000
    deframer.feed(data)
    return deframer.take(now_ns)


def test_both_versions_pass_whole_and_in_pieces() -> None:
    data = packed() + packed(mavlink1=True, sequence=7)
    whole = taken(Deframer(), data)
    deframer = Deframer()
    pieces = [frame for byte in data for frame in taken(deframer, bytes((byte,)))]
    assert whole == pieces
    assert [(one.sequence, one.is_mavlink1) for one in whole] == [(0, False), (7, True)]
    assert whole[0][2:] == (0, 255, 190, False)


def test_frame_after_rubbish_is_found() -> None:
    good = packed()
    for rubbish in (b"\xfd", b"\xfe\xff", b"hello", good[:9], good[:-1] + b"!", b"\xfd" * 300):
        deframer = Deframer()
        found = taken(deframer, rubbish + good * 20)
        assert len(found) >= 18, rubbish
        assert deframer.malformed or rubbish == b"hello"


STOP_FROM_CLIENT = mavlink.MAVLink_command_long_message(1, 1, 185, 0, 1.0, 0, 0, 0, 0, 0, 0)
STUCK = b"\xfd\xff\x00\x00\x00\xff\xbe\x00\x00\x00"
"""The header of a frame of 267 bytes."""


@each(
    "false",
    [
        b"\xfd\xff\x02",
        b"\xfd\xff\x40\x00",
        b"\xfe\xff" + bytes(4),
        b"\xfe\xff" + bytes(4),
    ],
)
def test_start_that_no_frame_can_have_delays_nothing(false: bytes) -> None:
    assert len(taken(Deframer(), false + packed())) == 1


@each(
    ("before", "behind"),
    [
        (STUCK, b""),
        (STUCK, STUCK),
        (STUCK[:4], b""),
        (b"\xfd", b""),
        (b"\xfe\x09\x00\x00\x00\x00", b""),
    ],
)
def test_emergency_stop_behind_an_unfinished_frame_is_found_at_once(
    before: bytes, behind: bytes
) -> None:
    for mavlink1 in (False, True):
        stop = packed(STOP_FROM_CLIENT, mavlink1=mavlink1)
        whole, pieces = Deframer(), Deframer()
        assert [one.data for one in taken(whole, before + stop + behind)] == [stop]
        found = [one for byte in before + stop for one in taken(pieces, bytes((byte,)))]
        assert [one.data for one in found] == [stop]
        assert taken(whole, b"", UNFINISHED_NS) == [], "it was taken twice"


def test_frames_carried_by_another_one_are_no_commands_but_for_a_stop() -> None:
    """An uploaded log may hold any: the outer frame arrives in pieces."""
    arm = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1.0, 0, 0, 0, 0, 0, 0)
    clear = mavlink.MAVLink_command_long_message(1, 1, 185, 0, 0.0, 0, 0, 0, 0, 0, 0)
    for carried in ([arm, clear], [STOP_FROM_CLIENT, clear], [STOP_FROM_CLIENT, arm]):
        inner = b"".join(map(packed, carried)).ljust(128, b"!")
        outer = packed(mavlink.MAVLink_tunnel_message(1, 1, 0, len(inner), inner))
        for cut in range(1, len(outer)):
            deframer = Deframer()
            found = [*taken(deframer, outer[:cut]), *taken(deframer, outer[cut:])]
            stops = [one for one in found if is_emergency_stop(one)]
            assert [one.data for one in found if one not in stops] == [outer], cut
            assert len(stops) <= (STOP_FROM_CLIENT in carried)


def test_no_frame_between_a_false_start_and_a_stop_is_lost() -> None:
    other = packed(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 0.0, 0, 0, 0, 0, 0, 0))
    deframer = Deframer()
    data = STUCK + other + packed(STOP_FROM_CLIENT) + packed()
    assert [one.data for one in taken(deframer, data)] == [packed(STOP_FROM_CLIENT)]
    later = taken(deframer, b"", UNFINISHED_NS)
    assert [one.data for one in later] == [other, packed()]


FORCED = 2989.0


@each("number", [185, 400])
@each("mavlink1", [False, True])
def test_release_sent_before_a_stop_found_behind_it_is_dropped(number: int, mavlink1: bool) -> None:
    values = (0.0, 0.0) if number == 185 else (1.0, FORCED)
    message = mavlink.MAVLink_command_long_message(1, 1, number, 0, *values, 0, 0, 0, 0, 0)
    release, stop = (packed(one, mavlink1=mavlink1) for one in (message, STOP_FROM_CLIENT))
    deframer = Deframer()
    assert [one.data for one in taken(deframer, STUCK + release + stop + release)] == [stop]
    later = taken(deframer, packed(), UNFINISHED_NS)
    assert [one.data for one in later] == [release, packed()], "that from after the stop"


def test_decoys_do_not_hold_up_the_search_for_a_stop() -> None:
    deframer, decoy = Deframer(), b"\xfe\x00\x00\x00\x00\x4c"
    for byte in (b"\x4a", b"\x4b", b"\x4c", b"\x4d"):
        hidden = b"\xfe" + packed(STOP_FROM_CLIENT, sequence=byte[0])
        assert len(taken(Deframer(), STUCK + hidden)) == 1, byte
    deframer.feed(STUCK + decoy * 20 + packed(STOP_FROM_CLIENT))
    found: list[MavFrame] = []
    for _ in range(4):
        deframer.allowance = 8
        found += deframer.take(0)
    assert len(found) == 1


def test_length_that_never_completes_costs_half_a_second() -> None:
    deframer, stuck = Deframer(), STUCK
    assert taken(deframer, stuck + packed()) == []
    assert taken(deframer, packed(), UNFINISHED_NS - 1) == []
    assert len(taken(deframer, packed(), UNFINISHED_NS)) == 3


def test_unknown_message_is_skipped_as_a_whole() -> None:
    deframer, unknown = Deframer(), bytearray(packed())
    unknown[7:10] = b"\xff\xff\x7f"
    assert len(taken(deframer, bytes(unknown) + packed())) == 1
    assert deframer.unknown == 1


def test_flag_that_changes_the_format_is_refused() -> None:
    odd = bytearray(packed())
    odd[2] = 0x02
    assert taken(Deframer(), bytes(odd)) == []


def test_allowance_bounds_the_work_and_the_memory() -> None:
    deframer = Deframer()
    deframer.feed(b"\xfd\x00\x00" * 100_000)
    deframer.allowance = 50
    assert deframer.take(0) == []
    assert deframer.allowance == 0
    assert len(deframer._waiting) <= MAX_WAITING
    assert deframer.dropped == 300_000 - MAX_WAITING


def test_random_bytes_and_damaged_frames_never_raise() -> None:
    random, link, data = Random(5), ClientLink(1, "peer", 0), packed()
    for turn in range(3_000):
        damaged = bytearray(data)
        damaged[random.randrange(len(damaged))] = random.randrange(256)
        rubbish = random.randbytes(random.randrange(40))
        link.allow(100)
        link.feed(bytes(damaged) + rubbish)
        for frame in link.frames(turn * NS_PER_S // 100):
            link.decode(frame)
    assert link.malformed > 1_000


def test_lost_frames_are_counted_per_sender() -> None:
    link = ClientLink(1, "peer", 0)
    link.allow(10)
    link.feed(packed(sequence=254) + packed(sequence=255) + packed(sequence=2))
    assert len(link.frames(0)) == 3
    assert (link.received, link.lost) == (3, 2)


def test_frame_that_was_overtaken_is_not_lost() -> None:
    link = ClientLink(1, "peer", 0)
    link.allow(10)
    for sequence in (254, 0, 255, 1, 2):
        link.feed(packed(sequence=sequence))
    assert len(link.frames(0)) == 5
    assert (link.received, link.lost) == (5, 0)


def test_line_is_lossy_while_frames_are_missing() -> None:
    link = ClientLink(1, "peer", 0)

    def hear(*sequences: int) -> bool:
        link.allow(len(sequences))
        link.feed(b"".join(packed(sequence=one % 256) for one in sequences))
        link.frames(0)
        return link.is_lossy

    assert not hear(*range(20))
    assert hear(*(one for one in range(20, 40) if one % 5))
    assert not hear(*range(40, 140))


def test_answers_are_in_the_version_of_the_client() -> None:
    link = ClientLink(1, "peer", 0)
    link.allow(10)
    link.feed(packed(mavlink1=True))
    message = link.decode(link.frames(0)[0])
    assert message is not None
    assert message.type == 6
    assert link.encode(1, HEARTBEAT, SigningGuard(lambda: 0))[0] == mavlink.PROTOCOL_MARKER_V1


RADIO = mavlink.MAVLink_radio_status_message(180, 180, 90, 40, 40, 0, 0)
COMPANION = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)


def version_after(*heard: tuple[object, int, int]) -> int:
    """Return the version of a link that has received messages, each of a system in a version."""
    link, encoder = ClientLink(1, "peer", 0), mavlink.MAVLink(None, 255, 190)
    for message, system, version in heard:
        encoder.srcSystem = system
        link.allow(10)
        link.feed(message.pack(encoder, force_mavlink1=version == 1))  # type: ignore[attr-defined]
        for frame in link.frames(0):
            link.decode(frame)
    return 1 if link.is_mavlink1 else 2


def test_radio_does_not_change_the_version_of_its_link() -> None:
    """It injects RADIO_STATUS in MAVLink 1."""
    assert version_after((RADIO, 51, 1)) == 2
    assert version_after((HEARTBEAT, 255, 2), (RADIO, 51, 1)) == 2
    assert version_after((HEARTBEAT, 255, 1), (RADIO, 51, 2)) == 1


def test_version_of_a_link_is_that_of_its_ground_station() -> None:
    assert version_after((COMPANION, 9, 1)) == 1
    assert version_after((COMPANION, 9, 1), (HEARTBEAT, 255, 2)) == 2
    assert version_after((COMPANION, 9, 2), (HEARTBEAT, 255, 1)) == 1
    assert version_after((HEARTBEAT, 255, 1), (COMPANION, 9, 2)) == 1
    assert version_after((HEARTBEAT, 255, 2), (COMPANION, 9, 1), (STOP_FROM_CLIENT, 9, 1)) == 2


def test_link_that_has_received_mavlink_2_keeps_it() -> None:
    assert version_after((HEARTBEAT, 255, 2), (HEARTBEAT, 255, 1)) == 2
    assert version_after((HEARTBEAT, 255, 1), (HEARTBEAT, 254, 2), (HEARTBEAT, 255, 1)) == 2
    assert version_after((COMPANION, 9, 2), (COMPANION, 9, 1)) == 2


@each("mavlink1", [False, True])
def test_each_vehicle_has_one_sequence_without_gaps(mavlink1: bool) -> None:
    link, guard = ClientLink(1, "peer", 0), SigningGuard(lambda: 0)
    link.is_mavlink1 = mavlink1
    kinds = (HEARTBEAT, mavlink.MAVLink_wheel_distance_message(0, 0, [0.0] * 16))
    frames = [link.encode(1 + at % 2, kinds[at % 3 == 0], guard) for at in range(1200)]
    found = mavlink.MAVLink(None).parse_buffer(b"".join(frames))
    for system in (1, 2):
        mine = [one for one in found if one.get_srcSystem() == system]
        assert [one.get_seq() for one in mine] == [at % 256 for at in range(len(mine))]
        assert {one.get_srcComponent() for one in mine} == {mavlink.MAV_COMP_ID_AUTOPILOT1}
    assert len(found) == (800 if mavlink1 else 1200)


class FakeEndpoint(PlayedEndpoint):
    def __init__(self) -> None:
        super().__init__()
        self.is_reliable = False
        self.forgotten: list[str] = []

    def forget(self, peer: str) -> None:
        self.forgotten.append(peer)


class Room:
    def __init__(self) -> None:
        self.endpoint = FakeEndpoint()
        self.log: list[tuple[str, int]] = []
        self.owner = 0
        self.clients = Clients(
            self._note("join"),
            self._note("leave"),
            lambda client: client.link.number == self.owner,
        )

    def _note(self, word: str) -> "Note":
        return Note(self.log, word)

    def feed(self, peer: str, data: bytes, now_ns: int = 0) -> None:
        self.clients.feed(self.endpoint, peer, data, now_ns, is_loopback=True)

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
    room.clients.connect(room.endpoint, "line", 0)
    room.clients.begin_round(0)
    room.feed("a", packed())
    assert len(list(room.frames())) == 1
    room.clients.begin_round(GONE_NS - 1)
    assert room.log == [("join", 1), ("join", 2)]
    room.clients.begin_round(GONE_NS)
    assert room.log[2:] == [("leave", 2)]
    room.clients.disconnect(room.endpoint, "line")
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
    room.clients.connect(room.endpoint, "web", 0)
    room.clients.begin_round(0)
    room.feed("web", begins + packed(STOP) + packed())
    assert list(room.frames()) == []
    assert room.endpoint.forgotten == ["web"]
    assert "web" not in room.peers()


def test_false_bytes_after_the_first_frame_close_no_tcp_connection(room: Room) -> None:
    room.endpoint.is_reliable = True
    room.clients.connect(room.endpoint, "line", 0)
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
    room.clients.connect(room.endpoint, "line", 0)
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
    peers = [f"tcp {number}" for number in range(MAX_PEERS + MAX_GUESTS + 1)]
    for peer in peers:
        room.clients.connect(room.endpoint, peer, 0)
    assert room.peers() == peers[:MAX_PEERS]
    assert room.endpoint.forgotten == [f"tcp {MAX_PEERS}"]
    last = peers[-1]
    room.feed(last, packed() + packed(STOP))
    assert [client.peer for client in room.frames()] == [last]
    for peer in ("tcp 0", *peers[MAX_PEERS:-1]):
        room.clients.disconnect(room.endpoint, peer)
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


def fed(link: ClientLink, *sequences: int) -> None:
    link.allow(100)
    for sequence in sequences:
        link.feed(packed(sequence=sequence))
    link.frames(0)


def test_state_of_all_clients_is_reported_once_a_second() -> None:
    reporter, one, other = Reporter(0), ClientLink(1, "a", 0), ClientLink(2, "b", 0)
    fed(one, 0, 1, 2, 5)
    fed(other, 0, 1)
    other.signing.signed, other.signing.forged, other.signing.future = 2, 3, 4
    reporter.sent(1, 3_000)
    reporter.sent(2, 100)
    owners = {1: Owner(2, 255), 2: None}
    first, second = reporter.take([one, other], owners, 2 * NS_PER_S)
    assert (first.system, first.clients, first.signing, first.owner) == (1, 2, 1, 255)
    assert (first.sent_bytes_s, second.sent_bytes_s) == (1_500, 50)
    assert (first.received_hz, first.lost_permille, first.refused) == (3, 250, 7)
    assert (second.system, second.owner) == (2, 0)
    assert not reporter.is_due(3 * NS_PER_S - 1)
    assert reporter.is_due(3 * NS_PER_S)


def test_client_that_has_gone_keeps_its_refused_frames() -> None:
    reporter, link = Reporter(0), ClientLink(1, "a", 0)
    fed(link, 0, 1)
    link.signing.replayed = 5
    reporter.take([link], {1: None}, NS_PER_S)
    reporter.left(link)
    (status,) = reporter.take([], {1: None}, 2 * NS_PER_S)
    assert (status.clients, status.refused, status.received_hz) == (0, 5, 0)


def test_frames_that_were_overtaken_are_no_negative_loss() -> None:
    reporter, link = Reporter(0), ClientLink(1, "a", 0)
    fed(link, 0, 3)
    (before,) = reporter.take([link], {1: None}, NS_PER_S)
    fed(link, 1, 2)
    (after,) = reporter.take([link], {1: None}, 2 * NS_PER_S)
    assert (before.lost_permille, after.lost_permille) == (500, 0)


MESSAGES = [
    ComponentMetadata(time_boot_ms=7, file_crc=0xDEADBEEF, uri=b"mftp:///general.json.xz"),
    AvailableModes(3, 1, 4, 15, 2, b"GUIDED"),
    CurrentMode(0, 10, 10),
    ControlStatus(3, 255, [1, 2, 0, 0, 0, 0, 0, 0, 0, 9]),
    *(
        MISSION_MESSAGES := [
            MissionCurrent(3, 7, 3, 1, 0xDEADBEEF, 0xFFFFFFFF, 1),
            MissionCount(1, 1, 200, 1, 0xDEADBEEF),
            MissionAck(255, 190, 15, 2, 0xDEADBEEF),
        ]
    ),
]


class Sink:
    def write(self, data: bytes) -> None:
        """Ignore the bytes."""


@each("message", MESSAGES)
def test_own_messages_survive_encoding_and_decoding(message: MavMessage) -> None:
    encoder = mavlink.MAVLink(Sink(), 1, 1)
    (found,) = encoder.parse_buffer(message.pack(encoder))
    assert found.to_dict() == message.to_dict()


@each("message", MESSAGES[1:3])
def test_own_layouts_are_those_of_the_development_dialect(message: MavMessage) -> None:
    theirs = development.mavlink_map[message.id]
    for fact in ("crc_extra", "ordered_fieldnames", "orders", "lengths", "array_lengths"):
        assert getattr(message, fact) == getattr(theirs, fact)
    assert message.unpacker.format == theirs.unpacker.format


@each("message", MISSION_MESSAGES)
def test_plan_ids_extend_the_messages_of_the_dialect(message: MavMessage) -> None:
    theirs = common.mavlink_map[message.id]
    assert message.crc_extra == theirs.crc_extra
    assert message.ordered_fieldnames[: len(theirs.ordered_fieldnames)] == theirs.ordered_fieldnames
    assert message.unpacker.format.startswith(theirs.unpacker.format)
