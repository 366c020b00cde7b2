"""Signed, forged and unsigned frames of four peers and two systems, through the whole gateway."""

from collections.abc import Sequence
from contextlib import ExitStack
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, cast

from fastcrc.crc16 import mcrf4xx

from checks.fuzz.gateway.payloads import (
    CHECKSUM_BYTES,
    HEADER_BYTES,
    KINDS,
    MAX_RECORDS,
    ROUND_NS,
    ROUNDS,
    SOME_ROUNDS,
    framed,
)
from checks.fuzz.gateway.robot import new_face
from gateways.mavlink.bus_port import BusPort
from gateways.mavlink.endpoints import ReceivedBytes
from gateways.mavlink.gateway import Gateway, WakeUp
from gateways.mavlink.mavlink_dialect import (
    REQUEST_OPERATOR_CONTROL,
    MavMessage,
    mavlink,
)
from gateways.mavlink.signing import EPOCH_S, PER_S, STAMP_NS, Policy, SigningGuard
from ground.user.mavlink_keys import KeyRing, SigningKey
from runtime.clock import ManualClock
from runtime.units import NS_PER_S

TRAFFIC: Final = (*KINDS, mavlink.MAVLINK_MSG_ID_SETUP_SIGNING, mavlink.MAVLINK_MSG_ID_HEARTBEAT)
SECRET, OLDER = b"s" * 32, b"o" * 32
DAY_NS: Final = 86_400 * NS_PER_S
PEER, IN_PIECES, SIGNED, RIGHT_KEY, REMOTE, OTHER_SYSTEM = 0x03, 0x04, 0x08, 0x10, 0x20, 0x40
"""Bits of the way in which a frame is sent."""
WAYS: Final = (0, SIGNED | RIGHT_KEY, SIGNED, REMOTE | 1, SIGNED | RIGHT_KEY | IN_PIECES)


class QueuedEndpoint:
    """An endpoint without a socket: what its peers send is given to the clients directly."""

    text = "udpin:fuzz"
    line_bytes_s = None
    is_reliable = False

    def filenos(self) -> list[int]:
        """Return no descriptor."""
        return []

    def lasting(self) -> list[str]:
        """Return no connection."""
        return []

    def gone(self) -> list[str]:
        """Return no ended connection."""
        return []

    def receive(self) -> list[ReceivedBytes]:
        """Return nothing: no descriptor is ready."""
        return []

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Ignore the frame."""

    def flush(self, now_ns: int) -> None:
        """Keep nothing."""

    def forget(self, peer: str) -> None:
        """Keep nothing."""

    def close(self) -> None:
        """Close nothing."""


def traffic(data: bytes, folder: Path) -> None:
    """Receive frames of four peers: bytes for kind, flags and way of sending, then the payload."""
    clock, endpoint, wake_up = ManualClock(), QueuedEndpoint(), WakeUp()
    ring = KeyRing(key=tuple(SigningKey(secret=key.hex()) for key in (SECRET, OLDER)))
    unix_ns = EPOCH_S * 10**9 + DAY_NS
    policies = {endpoint.text: list(Policy)[data[0] % len(Policy) if data else 0]}
    guard = SigningGuard(lambda: unix_ns + clock.now_ns(), ring, policies)
    face, robot = new_face(folder, guard)
    with ExitStack() as stack:
        stack.callback(wake_up.close)
        ports = [cast("BusPort", robot)]
        gateway = Gateway([endpoint], [face], ports, cast("Any", clock), wake_up, None, guard)
        stack.callback(gateway.close)
        at, count = 1, 0
        while at + 3 <= len(data) and count < MAX_RECORDS:
            number, robot.flags, way = TRAFFIC[data[at] % len(TRAFFIC)], data[at + 1], data[at + 2]
            size = mavlink.mavlink_map[number].unpacker.size
            payload = data[at + 3 : at + 3 + size].ljust(size, b"\0")
            at, count = at + 3 + size, count + 1
            stamp = DAY_NS // NS_PER_S * PER_S + clock.now_ns() // STAMP_NS + count
            frame = sent_frame(number, payload, way, stamp)
            cut = len(frame) // 2 if way & IN_PIECES else len(frame)
            for piece in (frame[:cut], frame[cut:]):
                peer, is_loopback = str(way & PEER), not way & REMOTE
                received_now = ReceivedBytes(peer, piece, is_loopback)
                gateway.clients.feed(endpoint, received_now, clock.now_ns())
            for _round in range(max(1, ROUNDS[robot.flags & 3])):
                clock.advance(ROUND_NS)
                gateway.round(longest_s=0.0)


def sent_frame(number: int, payload: bytes, way: int, stamp: int) -> bytes:
    """Return a frame of one of two systems, in the way that the flags tell."""
    system = 254 if way & OTHER_SYSTEM else 255
    if way & SIGNED:
        key = SECRET if way & RIGHT_KEY else OLDER if way & IN_PIECES else bytes(32)
        return signed(framed(number, payload, system), key, way & PEER, stamp)
    return framed(number, payload, system)


def signed(frame: bytes, key: bytes, link: int, stamp: int) -> bytes:
    """Return a frame with a signature by a key."""
    head, payload = bytearray(frame[1:HEADER_BYTES]), frame[HEADER_BYTES:-CHECKSUM_BYTES]
    head[1] |= mavlink.MAVLINK_IFLAG_SIGNED
    number = int.from_bytes(head[6:9], "little")
    extra = bytes((mavlink.mavlink_map[number].crc_extra,))
    checksum = mcrf4xx(bytes(head) + payload + extra).to_bytes(2, "little")
    whole = frame[:1] + bytes(head) + payload + checksum
    whole += bytes((link,)) + stamp.to_bytes(6, "little")
    return whole + sha256(key + whole).digest()[:6]


def traffic_records() -> Sequence[bytes]:
    """Return each kind of message in some ways, and requests that need each other."""
    found = []
    for place, number in enumerate(TRAFFIC):
        size = mavlink.mavlink_map[number].unpacker.size
        found += [bytes((1, place, 1, way)) + bytes(size) for way in WAYS]
    setup = mavlink.MAVLink_setup_signing_message(1, 1, list(SECRET), 0)
    asking = [
        mavlink.MAVLink_command_long_message(1, 1, REQUEST_OPERATOR_CONTROL, 0, *given)
        for given in ((1, 0, 5, 0, 0, 0, 0), (1, 1, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 0, 0))
    ]
    stop = mavlink.MAVLink_command_long_message(1, 1, 185, 0, 1, 0, 0, 0, 0, 0, 0)
    listing = mavlink.MAVLink_log_request_list_message(1, 1, 0, 9)
    whole = mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 1000)
    for messages in ([setup, *asking], [*asking, stop], [listing, whole, setup], [*asking] * 3):
        for ways in ((0, 1, 2, 3), (SIGNED | RIGHT_KEY, OTHER_SYSTEM | 1, SIGNED, REMOTE)):
            records = (traffic_record(one, ways[at % len(ways)]) for at, one in enumerate(messages))
            found.append(b"\1" + b"".join(records))
    return found


def traffic_record(message: MavMessage, way: int) -> bytes:
    """Return the bytes that `traffic` reads as a message."""
    frame: bytes = message.pack(mavlink.MAVLink(None, 255, 190))
    number = message.get_msgId()
    size = mavlink.mavlink_map[number].unpacker.size
    payload = frame[HEADER_BYTES:-CHECKSUM_BYTES].ljust(size, b"\0")
    return bytes((TRAFFIC.index(number), SOME_ROUNDS, way)) + payload
