"""Programs of the kernel's packet filter (classic BPF), and how a socket gets one. Works on Linux.

The kernel runs such a program for each packet of a socket, or to choose a socket of a port.
"""

import ctypes
import socket
import struct
from collections.abc import Iterator, Mapping, Sequence
from ipaddress import IPv4Address, IPv6Address
from typing import Final, NamedTuple

Address = IPv4Address | IPv6Address

SO_ATTACH_REUSEPORT_CBPF: Final = 51
SO_ATTACH_FILTER: Final = 26
SO_DETACH_FILTER: Final = 27

LOAD_WORD, LOAD_BYTE, LOAD_HALF_AT_X, LOAD_SIZE = 0x20, 0x30, 0x48, 0x80
AND, SHIFT_RIGHT, MOVE_TO_X, SUBTRACT_X = 0x54, 0x74, 0x07, 0x1C
JUMP, IF_EQUAL, IF_AT_LEAST, IF_ANY_BIT = 0x05, 0x15, 0x35, 0x45
RETURN, PASS, DROP = 0x06, 0xFFFF_FFFF, 0
ZENOH, ASIDE = 0, 1
"""The sockets of a port, in the order in which they began to listen."""

IP_HEADER: Final = 0xFFF0_0000
RANDOM: Final = 0xFFFF_F038
FLAGS_AT, LENGTH_AT, SOURCE_V4_AT, SOURCE_V6_AT = 13, 12, IP_HEADER + 12, IP_HEADER + 8
UDP_HEADER_BYTES: Final = 8
FIN, SYN, RST = 0x01, 0x02, 0x04
RECORD, RECORD_MASK = 0x1403, 0xFCFF
"""A TLS record begins with a type from 0x14 to 0x17 and the version 3."""


class Step(NamedTuple):
    """An instruction of the kernel's packet filter; `yes` and `no` count the steps to skip."""

    code: int
    value: int
    yes: int = 0
    no: int = 0


def tls_steps() -> list[Step]:
    """Return the filter for segments that begin like TLS.

    An empty segment passes, unless it ends the connection: Zenoh's sockets may close before the
    filter is removed, and wait for acknowledgements. The system keeps those that complete a silent
    connection (TCP_DEFER_ACCEPT). A load outside of a segment drops it.
    """
    return [
        Step(LOAD_BYTE, FLAGS_AT),
        Step(IF_ANY_BIT, RST | SYN, 0, 1),
        Step(RETURN, PASS),
        Step(LOAD_BYTE, LENGTH_AT),
        Step(AND, 0xF0),
        Step(SHIFT_RIGHT, 2),
        Step(MOVE_TO_X, 0),
        Step(LOAD_SIZE, 0),
        Step(SUBTRACT_X, 0),
        Step(IF_EQUAL, 0, 0, 4),
        Step(LOAD_BYTE, FLAGS_AT),
        Step(IF_ANY_BIT, FIN, 1, 0),
        Step(RETURN, PASS),
        Step(RETURN, DROP),
        Step(LOAD_HALF_AT_X, 0),
        Step(AND, RECORD_MASK),
        Step(IF_EQUAL, RECORD, 0, 1),
        Step(RETURN, PASS),
        Step(RETURN, DROP),
    ]


def datagram_steps(size: int, beginning: bytes) -> list[Step]:
    """Return the filter for UDP datagrams of a size that begin with these four bytes."""
    return [
        Step(LOAD_SIZE, 0),
        Step(IF_EQUAL, UDP_HEADER_BYTES + size, 0, 3),
        Step(LOAD_WORD, UDP_HEADER_BYTES),
        Step(IF_EQUAL, int.from_bytes(beginning, "big"), 0, 1),
        Step(RETURN, PASS),
        Step(RETURN, DROP),
    ]


def choice_steps(shares: Mapping[Address, float]) -> list[Step]:
    """Return the choice of the socket for a new connection.

    `shares` is the part of the connections of an address to let in.
    """
    v4 = [step for one, share in shares.items() if one.version == 4 for step in let(one, share)]
    v6 = [step for one, share in shares.items() if one.version == 6 for step in let(one, share)]
    return [
        Step(LOAD_BYTE, IP_HEADER),
        Step(SHIFT_RIGHT, 4),
        Step(IF_EQUAL, 4, 1, 0),
        Step(JUMP, len(v4) + 1),
        *v4,
        Step(RETURN, ZENOH),
        *v6,
        Step(RETURN, ZENOH),
    ]


def let(address: Address, share: float) -> Iterator[Step]:
    """Yield the steps that let in a share of the connections of an address."""
    first = SOURCE_V4_AT if address.version == 4 else SOURCE_V6_AT
    words = struct.unpack(f"!{len(address.packed) // 4}I", address.packed)
    for number, word in enumerate(words):
        yield Step(LOAD_WORD, first + 4 * number)
        yield Step(IF_EQUAL, word, 0, 2 * (len(words) - number - 1) + 4)
    yield Step(LOAD_WORD, RANDOM)
    yield Step(IF_AT_LEAST, min(2**32 - 1, round(share * 2**32)), 1, 0)
    yield Step(RETURN, ZENOH)
    yield Step(RETURN, ASIDE)


def attach(listener: socket.socket, steps: Sequence[Step], option: int) -> None:
    """Give a socket a program in place of the one before. Raises OSError."""
    packed = b"".join(struct.pack("HBBI", one.code, one.yes, one.no, one.value) for one in steps)
    code = ctypes.create_string_buffer(packed, len(packed))
    program = struct.pack("HP", len(steps), ctypes.addressof(code))
    listener.setsockopt(socket.SOL_SOCKET, option, program)
