"""The sockets of Zenoh's links, which its API does not reach: close, end and filter them.

Zenoh 1.10 sets SO_LINGER to 10 s on each TCP link (eclipse-zenoh/zenoh#2350). If the other end does
not read, closing the link blocks one of the few receive threads. Zenoh has no setting for it, so
this module clears the option on each link's socket. Zenoh's Python API cannot close a single link
either; its socket, which belongs to this process, can be shut down.

Programs of the kernel's packet filter (classic BPF) run for each packet of a socket, or to choose a
socket of a port. They work on Linux.
"""

import ctypes
import errno
import os
import socket
import struct
from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from ipaddress import IPv4Address, IPv6Address
from pathlib import Path
from threading import Event, Thread
from typing import Final, NamedTuple


class ConnectionEnd(NamedTuple):
    """One end of a connection."""

    host: str
    port: int


def end_in(address: str) -> ConnectionEnd:
    """Parse `10.0.0.7:50000` or `[::1]:50000`."""
    host, _, port = address.rpartition(":")
    return ConnectionEnd(plain_host(host), int(port) if port.isdecimal() else 0)


def plain_host(host: str) -> str:
    """Return a host without brackets and zone; an IPv4 address in IPv6 becomes a plain one."""
    host = host.strip("[]").partition("%")[0]
    with suppress(ValueError):
        return str(IPv6Address(host).ipv4_mapped or IPv6Address(host))
    return host


DESCRIPTORS: Final = Path("/proc/self/fd")
OFF: Final = struct.pack("ii", 0, 0)
STREAMS: Final = (socket.AF_INET, socket.AF_INET6)
NO_DESCRIPTOR: Final = (errno.EMFILE, errno.ENFILE)
AGAIN_S: Final = 0.1
"""Pause before the next attempt if no descriptor was left."""

MAX_ENDING: Final = 1000
"""Links to be ended at the same time; each attempt of a peer is a request of its own."""


def stop_lingering() -> None:
    """Clear SO_LINGER on all TCP sockets of this process. Works on Linux.

    Raises OSError if no file descriptor is left for the operation.
    """
    for one in tcp_sockets():
        with suppress(OSError):  # another thread has closed the socket
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, OFF)


def end_connections(peers: Collection[ConnectionEnd]) -> None:
    """Shut down the TCP connections of this process to some peers. Works on Linux.

    Raises OSError if no file descriptor is left for the operation.
    """
    for one in tcp_sockets() if peers else ():
        with suppress(OSError):  # it is not connected, or not any more
            host, port, *_ = one.getpeername()
            if ConnectionEnd(plain_host(host), port) in peers:
                one.shutdown(socket.SHUT_RDWR)


def tcp_sockets() -> Iterator[socket.socket]:
    """Yield a copy of each TCP socket of this process, open until the next one.

    Raises OSError if no file descriptor is left.
    """
    for descriptor in sockets():
        try:
            copy = socket_of(os.dup(descriptor))
        except OSError as error:  # another thread has closed the socket
            if error.errno in NO_DESCRIPTOR:
                raise
            continue
        with copy as one:
            if one.family in STREAMS and one.type == socket.SOCK_STREAM:
                yield one


def sockets() -> list[int]:
    """Return the descriptors of this process that are sockets."""
    found = []
    for entry in tuple(DESCRIPTORS.iterdir()) if DESCRIPTORS.is_dir() else ():
        with suppress(OSError):
            if os.readlink(entry).startswith("socket:"):
                found.append(int(entry.name))
    return found


def socket_of(descriptor: int) -> socket.socket:
    """Return the socket of a descriptor; close a descriptor that is no socket. Raises OSError."""
    try:
        return socket.socket(fileno=descriptor)
    except OSError:
        os.close(descriptor)
        raise


class LinkCloser:
    """Clear SO_LINGER, and end links, in a separate thread: there may be hundreds of sockets."""

    def __init__(self) -> None:
        self._wanted = Event()
        self._closed = Event()
        self._ending: deque[ConnectionEnd] = deque(maxlen=MAX_ENDING)
        self._thread: Thread | None = None

    def stop_lingering(self, *_: object) -> None:
        """Request clearing SO_LINGER on all present sockets; may be called from any thread."""
        self._wanted.set()
        if self._thread is None and not self._closed.is_set():
            self._thread = Thread(target=self._run, name="linger", daemon=True)
            self._thread.start()

    def end(self, address: str) -> None:
        """Request the end of the link to the peer at HOST:PORT; may be called from any thread."""
        self._ending.append(end_in(address))
        self.stop_lingering()

    def close(self) -> None:
        """End the thread."""
        self._closed.set()
        self._wanted.set()
        if self._thread is not None:
            self._thread.join(timeout=1.0)

    def _run(self) -> None:
        while not self._closed.is_set():
            self._wanted.wait()
            self._wanted.clear()
            ending = tuple(self._ending)
            try:
                end_connections(ending)
                stop_lingering()
            except OSError:  # a flood of connections holds all descriptors
                self._wanted.set()
                self._closed.wait(AGAIN_S)
                continue
            for _ in ending:
                self._ending.popleft()


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


class FilterStep(NamedTuple):
    """An instruction of the kernel's packet filter; `yes` and `no` count the steps to skip."""

    code: int
    value: int
    yes: int = 0
    no: int = 0


def tls_steps() -> list[FilterStep]:
    """Return the filter for segments that begin like TLS.

    An empty segment passes, unless it ends the connection: Zenoh's sockets may close before the
    filter is removed, and wait for acknowledgements. The system keeps those that complete a silent
    connection (TCP_DEFER_ACCEPT). A load outside of a segment drops it.
    """
    return [
        FilterStep(LOAD_BYTE, FLAGS_AT),
        FilterStep(IF_ANY_BIT, RST | SYN, 0, 1),
        FilterStep(RETURN, PASS),
        FilterStep(LOAD_BYTE, LENGTH_AT),
        FilterStep(AND, 0xF0),
        FilterStep(SHIFT_RIGHT, 2),
        FilterStep(MOVE_TO_X, 0),
        FilterStep(LOAD_SIZE, 0),
        FilterStep(SUBTRACT_X, 0),
        FilterStep(IF_EQUAL, 0, 0, 4),
        FilterStep(LOAD_BYTE, FLAGS_AT),
        FilterStep(IF_ANY_BIT, FIN, 1, 0),
        FilterStep(RETURN, PASS),
        FilterStep(RETURN, DROP),
        FilterStep(LOAD_HALF_AT_X, 0),
        FilterStep(AND, RECORD_MASK),
        FilterStep(IF_EQUAL, RECORD, 0, 1),
        FilterStep(RETURN, PASS),
        FilterStep(RETURN, DROP),
    ]


def datagram_steps(size: int, beginning: bytes) -> list[FilterStep]:
    """Return the filter for UDP datagrams of a size that begin with these four bytes."""
    return [
        FilterStep(LOAD_SIZE, 0),
        FilterStep(IF_EQUAL, UDP_HEADER_BYTES + size, 0, 3),
        FilterStep(LOAD_WORD, UDP_HEADER_BYTES),
        FilterStep(IF_EQUAL, int.from_bytes(beginning, "big"), 0, 1),
        FilterStep(RETURN, PASS),
        FilterStep(RETURN, DROP),
    ]


def choice_steps(shares: Mapping[Address, float]) -> list[FilterStep]:
    """Return the choice of the socket for a new connection.

    `shares` is the part of the connections of an address to let in.
    """
    v4 = [step for one, share in shares.items() if one.version == 4 for step in let(one, share)]
    v6 = [step for one, share in shares.items() if one.version == 6 for step in let(one, share)]
    return [
        FilterStep(LOAD_BYTE, IP_HEADER),
        FilterStep(SHIFT_RIGHT, 4),
        FilterStep(IF_EQUAL, 4, 1, 0),
        FilterStep(JUMP, len(v4) + 1),
        *v4,
        FilterStep(RETURN, ZENOH),
        *v6,
        FilterStep(RETURN, ZENOH),
    ]


def let(address: Address, share: float) -> Iterator[FilterStep]:
    """Yield the steps that let in a share of the connections of an address."""
    first = SOURCE_V4_AT if address.version == 4 else SOURCE_V6_AT
    words = struct.unpack(f"!{len(address.packed) // 4}I", address.packed)
    for number, word in enumerate(words):
        yield FilterStep(LOAD_WORD, first + 4 * number)
        yield FilterStep(IF_EQUAL, word, 0, 2 * (len(words) - number - 1) + 4)
    yield FilterStep(LOAD_WORD, RANDOM)
    yield FilterStep(IF_AT_LEAST, min(2**32 - 1, round(share * 2**32)), 1, 0)
    yield FilterStep(RETURN, ZENOH)
    yield FilterStep(RETURN, ASIDE)


def attach(listener: socket.socket, steps: Sequence[FilterStep], option: int) -> None:
    """Give a socket a program in place of the one before. Raises OSError."""
    packed = b"".join(struct.pack("HBBI", one.code, one.yes, one.no, one.value) for one in steps)
    code = ctypes.create_string_buffer(packed, len(packed))
    program = struct.pack("HP", len(steps), ctypes.addressof(code))
    listener.setsockopt(socket.SOL_SOCKET, option, program)
