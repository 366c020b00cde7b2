"""The sockets and serial lines of the gateway on its event loop: they alone do I/O with clients.

`udpin:HOST:PORT` waits for clients, `udpout:HOST:PORT` sends first, `tcpin:HOST:PORT` serves each
client that connects, and `serial:DEVICE:BAUD` has one client (8 data bits, no parity, 1 stop bit).
A host may be an IPv6 address in brackets, and `//` may stand before it, as clients write it.
Of the frames that wait for a slow line, telemetry is dropped first; no queue grows without bound.
"""

import asyncio
import errno
import os
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from difflib import get_close_matches
from functools import lru_cache, partial
from ipaddress import IPv6Address, ip_address
from types import MappingProxyType
from typing import Any, Final, NamedTuple, Protocol

from protocol.bus.network import MAX_PORT
from runtime.errors import UserError
from runtime.serial_line import SERIAL_EXAMPLE, open_first, open_line

Address = tuple[Any, ...]
"""Host and port; for IPv6 with two more numbers."""
SOCKET_ADVICE = {
    errno.EADDRINUSE: "another process uses this port: end it, or give another port",
    errno.EACCES: "ports below 1024 need rights of root: give a higher port",
    errno.EADDRNOTAVAIL: "this machine does not have the address: give 127.0.0.1 or 0.0.0.0",
}


@contextmanager
def explained(text: str) -> Iterator[None]:
    """Turn an OSError into a UserError with the endpoint and what to do."""
    try:
        yield
    except socket.gaierror as error:
        raise UserError(f"{text}: unknown host: check the name, or give an address") from error
    except OSError as error:
        why = SOCKET_ADVICE.get(error.errno or 0, error.strerror or str(error))
        raise UserError(f"{text}: {why}") from error


CACHED: Final = 64
"""Addresses whose text is kept: more than there are clients."""


def resolved(host: str, port: int) -> tuple[socket.AddressFamily, Address]:
    """Return the address of a host, of IPv4 if it has both; brackets may enclose one of IPv6."""
    found = socket.getaddrinfo(host.strip("[]"), port, type=socket.SOCK_DGRAM)
    family, *_, address = min(found, key=lambda one: one[0] != socket.AF_INET)
    return family, address


@lru_cache(CACHED)
def name_of(address: Address) -> str:
    """Return an address as text."""
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


@lru_cache(CACHED)
def address_of(name: str) -> Address:
    """Return the address that a text names."""
    host, _, port = name.rpartition(":")
    return host.strip("[]"), int(port)


@lru_cache(CACHED)
def is_loopback(address: Address) -> bool:
    """Return whether an address is of this machine only.

    A socket for both kinds shows an IPv4 address inside of one of IPv6.
    """
    found = ip_address(address[0])
    mapped = found.ipv4_mapped if isinstance(found, IPv6Address) else None
    return (mapped or found).is_loopback


MAX_PEERS: Final = 16
"""Clients of one endpoint at a time; more are not served."""


class Arrival(NamedTuple):
    """Bytes of a peer, whose name is unique within its endpoint."""

    peer: str
    data: bytes
    is_loopback: bool


class Receiver(Protocol):
    """Takes what arrives at endpoints, at once."""

    def connected(self, endpoint: "Endpoint", peer: str) -> None:
        """Note a peer that stays while it is silent: a connection or a line."""

    def disconnected(self, endpoint: "Endpoint", peer: str) -> None:
        """Note that its connection or line has ended."""

    def received(self, endpoint: "Endpoint", arrived: Sequence[Arrival]) -> None:
        """Process bytes of peers."""


class Endpoint(Protocol):
    """An open socket or serial line."""

    @property
    def text(self) -> str:
        """The endpoint as it was given, such as `udpin:127.0.0.1:14550`."""

    @property
    def line_bytes_s(self) -> int | None:
        """Capacity of the line in bytes per second; None if it has no limit."""

    @property
    def is_reliable(self) -> bool:
        """True if no frame is lost on the way, as with TCP."""

    async def attach(self, receiver: Receiver) -> None:
        """Begin to receive in the running event loop."""

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send a frame; if the line is slow, drop telemetry first, then all frames."""

    def forget(self, peer: str) -> None:
        """End the connection of a client, if it has one."""

    def close(self) -> None:
        """Close it."""


MAX_DATAGRAM: Final = 65_536
MAX_DATAGRAMS: Final = 64
"""Datagrams that are read at once; a turn of the event loop costs as much as to process one."""


class UdpEndpoint:
    """A UDP socket. `listens`: it is bound to the address, otherwise that is its only peer."""

    line_bytes_s = None
    is_reliable = False

    def __init__(self, text: str, host: str, port: int, *, listens: bool) -> None:
        self.text = text
        self._loop: asyncio.AbstractEventLoop | None = None
        with explained(text):
            family, address = resolved(host, port)
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            with explained(text):
                if listens:
                    self._socket.bind(address)
        except BaseException:
            self._socket.close()
            raise
        self._only = None if listens else name_of(address)

    @property
    def port(self) -> int:
        """The real port, if 0 was given."""
        return int(self._socket.getsockname()[1])

    async def attach(self, receiver: Receiver) -> None:
        """Begin to receive; an only peer is sent to before anything has come from it."""
        self._receiver, self._loop = receiver, asyncio.get_running_loop()
        self._loop.add_reader(self._socket, self._read)
        if self._only is not None:
            receiver.connected(self, self._only)

    def _read(self) -> None:
        """Pass on the datagrams that have arrived."""
        arrived = []
        with suppress(OSError):  # most often: there is none left
            for _ in range(MAX_DATAGRAMS):
                data, address = self._socket.recvfrom(MAX_DATAGRAM)
                peer = name_of(address)
                if self._only in (None, peer):
                    arrived.append(Arrival(peer, data, is_loopback(address)))
        if arrived:
            self._receiver.received(self, arrived)

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send one datagram; drop it if the socket's buffer is full."""
        with suppress(OSError):
            self._socket.sendto(data, address_of(peer))

    def forget(self, peer: str) -> None:
        """Keep nothing of a peer."""

    def close(self) -> None:
        """Close the socket."""
        if self._loop is not None:
            self._loop.remove_reader(self._socket)
            self._loop = None
        self._socket.close()


MAX_BYTES: Final = 65_536
STREAM_BYTES: Final = 2_048
"""With this much waiting, a frame of telemetry is dropped, because a newer one follows."""
MAX_TCP_READ: Final = 16_384
MAX_CONNECTIONS: Final = 2 * MAX_PEERS
"""More are closed at once. Those without a place stay open for an emergency stop."""
VANISHED_MS: Final = 10_000
"""A connection ends if the other side confirms nothing for so long, as after a cut."""


def has_room(waiting: int, size: int, stream_bytes: int, *, is_stream: bool) -> bool:
    """Return whether a frame may wait behind so many bytes; a free line takes any."""
    return not waiting or waiting + size <= (stream_bytes if is_stream else MAX_BYTES)


class Connection(asyncio.BufferedProtocol):
    """One client of a TCP endpoint; it has no `peer` if there are too many."""

    transport: asyncio.Transport
    peer: str | None = None
    is_loopback = False

    def __init__(self, endpoint: "TcpEndpoint") -> None:
        self._endpoint = endpoint
        self._buffer = bytearray(MAX_TCP_READ)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin, or end at once if there are too many."""
        assert isinstance(transport, asyncio.Transport), "it is one of streams"
        self.transport = transport
        self._endpoint.begin(self)

    def get_buffer(self, sizehint: int) -> bytearray:
        """Return room for the next bytes."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Pass the bytes on."""
        if self.peer is not None:
            data = bytes(memoryview(self._buffer)[:nbytes])
            self._endpoint.received(self, self.peer, data)

    def eof_received(self) -> None:
        """End: a client that sends no more is gone."""
        self.transport.abort()

    def connection_lost(self, error: Exception | None) -> None:
        """Note the end."""
        if self.peer is not None:
            self._endpoint.forget(self.peer)


class TcpEndpoint:
    """A listening socket and its connections."""

    line_bytes_s = None
    is_reliable = True

    def __init__(self, text: str, host: str, port: int) -> None:
        self.text = text
        self.refused = self.dropped = 0
        self._connections: dict[str, Connection] = {}
        self._server: asyncio.Server | None = None
        with explained(text):
            family, address = resolved(host, port)
            self._socket = socket.socket(family, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            with explained(text):
                self._socket.bind(address)
                self._socket.listen(MAX_CONNECTIONS)
        except BaseException:
            self._socket.close()
            raise

    @property
    def port(self) -> int:
        """The real port, if 0 was given."""
        return int(self._socket.getsockname()[1])

    async def attach(self, receiver: Receiver) -> None:
        """Begin to accept connections."""
        self._receiver = receiver
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(
            lambda: Connection(self), sock=self._socket, backlog=MAX_CONNECTIONS
        )

    def begin(self, connection: Connection) -> None:
        """Add a connection, or end it if there are too many."""
        if len(self._connections) >= MAX_CONNECTIONS:
            self.refused += 1
            connection.transport.abort()
            return
        connected: Any = connection.transport.get_extra_info("socket")
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, VANISHED_MS)
        address: Address = connection.transport.get_extra_info("peername")
        connection.peer, connection.is_loopback = name_of(address), is_loopback(address)
        self._connections[connection.peer] = connection
        self._receiver.connected(self, connection.peer)

    def received(self, connection: Connection, peer: str, data: bytes) -> None:
        """Pass on bytes of a client."""
        self._receiver.received(self, [Arrival(peer, data, connection.is_loopback)])

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send a frame, or keep it if the client reads slowly, or drop it."""
        connection = self._connections.get(peer)
        if connection is None or connection.transport.is_closing():
            return
        waiting = connection.transport.get_write_buffer_size()
        if has_room(waiting, len(data), STREAM_BYTES, is_stream=is_stream):
            connection.transport.write(data)
        else:
            self.dropped += 1

    def forget(self, peer: str) -> None:
        """End the connection of a client."""
        connection = self._connections.pop(peer, None)
        if connection is not None:
            connection.transport.abort()
            self._receiver.disconnected(self, peer)

    def close(self) -> None:
        """Close all sockets."""
        for connection in self._connections.values():
            connection.transport.abort()
        if self._server is None:
            self._socket.close()
        else:
            self._server.close()


BITS_PER_BYTE: Final = 10
USED_SHARE: Final = 5 / 6
"""The part of the line that is used: a radio adds bytes of its own."""
MAX_SERIAL_READ: Final = 4_096
REOPEN_S: Final = 1.0
STREAMS_WAIT_S: Final = 0.1


class SerialEndpoint:
    """A serial line. It is opened again if it is lost, for example if the adapter is unplugged."""

    is_reliable = False

    def __init__(self, text: str, device: str, baud: int) -> None:
        self.text = text
        self.line_bytes_s = round(baud / BITS_PER_BYTE * USED_SHARE)
        self.dropped = 0
        self._device, self._baud = device, baud
        self._stream_bytes = round(self.line_bytes_s * STREAMS_WAIT_S)
        self._waiting = bytearray()
        self._descriptor: int | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._again: asyncio.TimerHandle | None = None
        self._descriptor = open_first(text, device, baud)

    async def attach(self, receiver: Receiver) -> None:
        """Begin to receive; the line is the only peer."""
        self._receiver, self._loop = receiver, asyncio.get_running_loop()
        self._begin(self._loop)

    def _begin(self, loop: asyncio.AbstractEventLoop) -> None:
        assert self._descriptor is not None, "the line is open"
        loop.add_reader(self._descriptor, self._read)
        self._receiver.connected(self, self._device)

    def _read(self) -> None:
        """Pass on what has arrived. A line may be a radio, so its client is another machine's."""
        assert self._descriptor is not None, "only an open line is read"
        try:
            data = os.read(self._descriptor, MAX_SERIAL_READ)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._receiver.received(self, [Arrival(self._device, data, is_loopback=False)])
        else:
            self._lose()

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send a frame, or keep it if the line is full, or drop it."""
        if self._descriptor is None:
            return
        if has_room(len(self._waiting), len(data), self._stream_bytes, is_stream=is_stream):
            self._waiting += data
            self._write()
        else:
            self.dropped += 1

    def _write(self) -> None:
        """Write the waiting frames, as many as the line accepts; the rest when it has room."""
        assert self._descriptor is not None, "only an open line is written to"
        assert self._loop is not None, "it is attached"
        try:
            del self._waiting[: os.write(self._descriptor, self._waiting)]
        except BlockingIOError:
            pass
        except OSError:
            self._lose()
            return
        if self._waiting:
            self._loop.add_writer(self._descriptor, self._write)
        else:
            self._loop.remove_writer(self._descriptor)

    def forget(self, peer: str) -> None:
        """Do nothing: the line stays."""

    def close(self) -> None:
        """Close the line."""
        if self._again is not None:
            self._again.cancel()
        if self._descriptor is not None:
            if self._loop is not None:
                self._loop.remove_reader(self._descriptor)
                self._loop.remove_writer(self._descriptor)
            os.close(self._descriptor)
            self._descriptor = None

    def _lose(self) -> None:
        assert self._loop is not None, "it is attached"
        self.close()
        self._waiting.clear()
        self._again = self._loop.call_later(REOPEN_S, self._reopen, self._loop)
        self._receiver.disconnected(self, self._device)

    def _reopen(self, loop: asyncio.AbstractEventLoop) -> None:
        try:
            self._descriptor = open_line(self._device, self._baud)
        except OSError:
            self._again = loop.call_later(REOPEN_S, self._reopen, loop)
        else:
            self._begin(loop)


TCP: Final = "tcpin"
SERIAL: Final = "serial"
KINDS: Final[Mapping[str, Callable[[str, str, int], Endpoint]]] = MappingProxyType(
    {
        "udpin": partial(UdpEndpoint, listens=True),
        "udpout": partial(UdpEndpoint, listens=False),
        TCP: TcpEndpoint,
        SERIAL: SerialEndpoint,
    }
)
EXAMPLE: Final = "udpin:127.0.0.1:14550"


class EndpointParts(NamedTuple):
    """The parts of an endpoint: its kind, host or device, and port or speed."""

    kind: str
    name: str
    number: int


def parsed(text: str) -> EndpointParts:
    """Parse an endpoint; UserError names the error and the fix."""
    kind, _, rest = text.partition(":")
    if kind not in KINDS:
        near = get_close_matches(kind, KINDS, n=1)
        fix = f"did you mean {near[0]}?" if near else f"use one as in {EXAMPLE}"
        raise UserError(f"endpoint {text!r}: {kind!r} is none of {', '.join(KINDS)}; {fix}")
    place, _, number = rest.removeprefix("//").rpartition(":")
    form, example = "HOST:PORT", EXAMPLE.replace("udpin", kind)
    if kind == SERIAL:
        form, example = "DEVICE:BAUD", SERIAL_EXAMPLE
    if not (place and number.isascii() and number.isdecimal()):
        raise UserError(f"endpoint {text!r}: use {kind}:{form}, as in {example}")
    if kind != SERIAL and int(number) > MAX_PORT:
        raise UserError(f"endpoint {text!r}: ports end at {MAX_PORT}")
    return EndpointParts(kind, place, int(number))


def opened(text: str) -> Endpoint:
    """Open an endpoint; UserError names the error and the fix."""
    kind, name, number = parsed(text)
    return KINDS[kind](text, name, number)


def all_opened(texts: Sequence[str]) -> list[Endpoint]:
    """Open several endpoints; after a UserError none remains open."""
    with ExitStack() as stack:
        found = [stack.enter_context(closing(opened(text))) for text in texts]
        stack.pop_all()
    return found
