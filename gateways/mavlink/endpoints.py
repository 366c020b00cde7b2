"""The sockets and serial lines of the gateway, which alone do I/O with clients and never block.

`udpin:HOST:PORT` waits for clients, `udpout:HOST:PORT` sends first, `tcpin:HOST:PORT` serves each
client that connects, and `serial:DEVICE:BAUD` has one client (8 data bits, no parity, 1 stop bit).
Of the frames that wait for a slow line, telemetry is dropped first.
"""

import errno
import fcntl
import os
import socket
import termios
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from difflib import get_close_matches
from functools import partial
from ipaddress import ip_address
from types import MappingProxyType
from typing import Final, NamedTuple, Protocol

from protocol.bus.network import MAX_PORT
from runtime.errors import UserError
from runtime.units import NS_PER_S

Address = tuple[str, int]
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


def resolved(host: str, port: int) -> Address:
    """Return the IPv4 address of a host."""
    return socket.gethostbyname(host), port


def name_of(address: Address) -> str:
    """Return an address as text."""
    return f"{address[0]}:{address[1]}"


def is_loopback(address: Address) -> bool:
    """Return whether an address is of this machine only."""
    return ip_address(address[0]).is_loopback


MAX_PEERS: Final = 16
"""Clients of one endpoint at a time; more are not served."""


class ReceivedBytes(NamedTuple):
    """Bytes from one peer; `peer` is unique within the endpoint."""

    peer: str
    data: bytes
    is_loopback: bool


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

    def filenos(self) -> list[int]:
        """Return the descriptors to wait for."""

    def lasting(self) -> Collection[str]:
        """Return the peers that stay present while they are silent: connections and lines."""

    def gone(self) -> list[str]:
        """Return the peers whose connection has ended since the last call."""

    def receive(self) -> list[ReceivedBytes]:
        """Return the bytes that have arrived, at most as many as one round can process."""

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send a frame; if the line is slow, drop telemetry first, then all frames."""

    def flush(self, now_ns: int) -> None:
        """Send the waiting frames; open a lost line again."""

    def forget(self, peer: str) -> None:
        """Drop the state of a client that has disconnected."""

    def close(self) -> None:
        """Close it."""


MAX_BYTES: Final = 65_536
STREAM_BYTES: Final = 2_048
"""With this much waiting, a frame of telemetry is dropped, because a newer one follows."""


class SendBuffer:
    """Sends by `write`, which returns how many bytes it took and never blocks."""

    def __init__(self, write: Callable[[bytes], int], stream_bytes: int = STREAM_BYTES) -> None:
        self.dropped = 0
        self._write = write
        self._stream_bytes = stream_bytes
        self._waiting = bytearray()

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, data: bytes, *, is_stream: bool) -> None:
        """Send a frame, now or later, or drop it; OSError if the line is lost."""
        limit = self._stream_bytes if is_stream else MAX_BYTES
        if self._waiting and len(self._waiting) + len(data) > limit:
            self.dropped += 1
            return
        self._waiting += data
        self.flush()

    def flush(self) -> None:
        """Send the waiting frames, as many as the line accepts; OSError if the line is lost."""
        if not self._waiting:
            return
        try:
            taken = self._write(bytes(self._waiting))
        except BlockingIOError:
            return
        del self._waiting[:taken]


LARGEST_DATAGRAM: Final = 65_535
MAX_DATAGRAMS: Final = 256
"""Datagrams read in one round, so that a flood does not delay the vehicles."""


class UdpEndpoint:
    """A UDP socket. `listens`: it is bound to the address, otherwise that is its only peer."""

    line_bytes_s = None
    is_reliable = False

    def __init__(self, text: str, host: str, port: int, *, listens: bool) -> None:
        self.text = text
        self.refused = 0
        self._addresses: dict[str, Address] = {}
        self._fixed: tuple[str, ...] = ()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            with explained(text):
                address = resolved(host, port)
                if listens:
                    self._socket.bind(address)
        except BaseException:
            self._socket.close()
            raise
        if not listens:
            self._fixed = (name_of(address),)
            self._addresses[name_of(address)] = address

    @property
    def port(self) -> int:
        """The real port, if 0 was given."""
        return int(self._socket.getsockname()[1])

    def filenos(self) -> list[int]:
        """Return the descriptor."""
        return [self._socket.fileno()]

    def lasting(self) -> Collection[str]:
        """Return the address to send to before anything has been received from it."""
        return self._fixed

    def gone(self) -> list[str]:
        """Return nothing: UDP has no connections."""
        return []

    def receive(self) -> list[ReceivedBytes]:
        """Return the datagrams that have arrived, at most MAX_READ, of at most MAX_PEERS peers."""
        found = []
        for _ in range(MAX_DATAGRAMS):
            try:
                data, address = self._socket.recvfrom(LARGEST_DATAGRAM)
            except BlockingIOError:
                break
            except OSError:
                continue
            peer = name_of(address)
            if self._admits(peer):
                self._addresses[peer] = address
                found.append(ReceivedBytes(peer, data, is_loopback(address)))
        return found

    def _admits(self, peer: str) -> bool:
        if peer in self._addresses:
            return True
        if self._fixed or len(self._addresses) >= MAX_PEERS + MAX_DATAGRAMS:
            self.refused += 1
            return False
        return True

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send one datagram; drop it if the socket's buffer is full."""
        address = self._addresses.get(peer)
        if address is not None:
            with suppress(OSError):
                self._socket.sendto(data, address)

    def flush(self, now_ns: int) -> None:
        """Do nothing: no datagram waits."""

    def forget(self, peer: str) -> None:
        """Drop the address of a client that has disconnected."""
        if peer not in self._fixed:
            self._addresses.pop(peer, None)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


MAX_TCP_READ: Final = 16_384
MAX_CONNECTIONS: Final = 2 * MAX_PEERS
"""More are closed at once. Those without a place stay open for an emergency stop."""
VANISHED_MS: Final = 10_000
"""A connection ends if the other side confirms nothing for so long, as after a cut."""
MAX_ACCEPTS: Final = 4
"""Connections accepted in one round."""


class Connection:
    """One client."""

    def __init__(self, connected: socket.socket, *, is_loopback: bool) -> None:
        connected.setblocking(False)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, VANISHED_MS)
        self.socket = connected
        self.buffer = SendBuffer(connected.send)
        self.is_loopback = is_loopback


class TcpEndpoint:
    """A listening socket and its connections."""

    line_bytes_s = None
    is_reliable = True

    def __init__(self, text: str, host: str, port: int) -> None:
        self.text = text
        self.refused = 0
        self._gone: list[str] = []
        self._connections: dict[str, Connection] = {}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            with explained(text):
                self._socket.bind(resolved(host, port))
                self._socket.listen(MAX_CONNECTIONS)
        except BaseException:
            self._socket.close()
            raise

    @property
    def port(self) -> int:
        """The real port, if 0 was given."""
        return int(self._socket.getsockname()[1])

    def filenos(self) -> list[int]:
        """Return the descriptors of the listening socket and of all connections."""
        connected = (one.socket.fileno() for one in self._connections.values())
        return [self._socket.fileno(), *connected]

    def lasting(self) -> Collection[str]:
        """Return the clients that are connected."""
        return self._connections

    def gone(self) -> list[str]:
        """Return the clients that have disconnected since the last call."""
        gone, self._gone = self._gone, []
        return gone

    def receive(self) -> list[ReceivedBytes]:
        """Accept connections; return what their clients have sent."""
        for _ in range(MAX_ACCEPTS):
            try:
                connected, address = self._socket.accept()
            except OSError:
                break
            if len(self._connections) >= MAX_CONNECTIONS:
                self.refused += 1
                connected.close()
                continue
            loopback = is_loopback(address)
            self._connections[name_of(address)] = Connection(connected, is_loopback=loopback)
        found = []
        for peer, one in list(self._connections.items()):
            try:
                data = one.socket.recv(MAX_TCP_READ)
            except BlockingIOError:
                continue
            except OSError:
                data = b""
            if data:
                found.append(ReceivedBytes(peer, data, one.is_loopback))
            else:
                self._end(peer)
        return found

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send a frame, or keep it if the client reads slowly, or drop it."""
        connection = self._connections.get(peer)
        if connection is not None:
            try:
                connection.buffer.add(data, is_stream=is_stream)
            except OSError:
                self._end(peer)

    def flush(self, now_ns: int) -> None:
        """Send the waiting frames."""
        for peer, connection in list(self._connections.items()):
            try:
                connection.buffer.flush()
            except OSError:
                self._end(peer)

    def forget(self, peer: str) -> None:
        """End the connection of a client."""
        self._end(peer)

    def close(self) -> None:
        """Close all sockets."""
        for peer in list(self._connections):
            self._end(peer)
        self._socket.close()

    def _end(self, peer: str) -> None:
        connection = self._connections.pop(peer, None)
        if connection is not None:
            self._gone.append(peer)
            with suppress(OSError):
                connection.socket.close()


BITS_PER_BYTE: Final = 10
USED_SHARE: Final = 5 / 6
"""The part of the line that is used: a radio adds bytes of its own."""
MAX_SERIAL_READ: Final = 4_096
REOPEN_NS: Final = NS_PER_S
STREAMS_WAIT_S: Final = 0.1
SPEEDS: Final = {
    int(name[1:]): value
    for name, value in vars(termios).items()
    if name[0] == "B" and name[1:].isdecimal() and int(name[1:]) > 0
}
"""The speeds that this system supports, with their codes."""
SERIAL_ADVICE: Final = {
    errno.ENOENT: "no such device: list them with `ls /dev/tty* /dev/serial/by-id`",
    errno.ENXIO: "no such device: list them with `ls /dev/tty* /dev/serial/by-id`",
    errno.EACCES: "missing rights: join the group `dialout`, then log in again",
    errno.EBUSY: "another process uses this line: end it",
    errno.ENOTTY: "this file is not a serial line",
}


class SerialEndpoint:
    """A serial line. It is opened again if it is lost, for example if the adapter is unplugged."""

    is_reliable = False

    def __init__(self, text: str, device: str, baud: int) -> None:
        self.text = text
        self.line_bytes_s = round(baud / BITS_PER_BYTE * USED_SHARE)
        self._device, self._baud = device, baud
        self._descriptor: int | None = None
        self._tried_ns = 0
        self._gone: list[str] = []
        if baud not in SPEEDS:
            usual = "9600, 57600, 115200 or 921600"
            raise UserError(f"{text}: {baud} baud is not possible here: give {usual}")
        try:
            self._open()
        except (OSError, termios.error) as error:
            number = error.args[0] if error.args else 0
            why = SERIAL_ADVICE.get(number, str(error))
            raise UserError(f"{text}: {why}") from error

    def _open(self) -> None:
        descriptor = os.open(self._device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            speed = SPEEDS[self._baud]
            *_, characters = termios.tcgetattr(descriptor)
            control = termios.CS8 | termios.CREAD | termios.CLOCAL
            raw = [0, 0, control, 0, speed, speed, characters]
            termios.tcsetattr(descriptor, termios.TCSANOW, raw)
            fcntl.ioctl(descriptor, termios.TIOCEXCL)
        except BaseException:
            os.close(descriptor)
            raise
        waiting = round(self.line_bytes_s * STREAMS_WAIT_S)
        self._buffer = SendBuffer(lambda data: os.write(descriptor, data), waiting)
        self._descriptor = descriptor

    def filenos(self) -> list[int]:
        """Return the descriptor, unless the line is lost."""
        return [] if self._descriptor is None else [self._descriptor]

    def lasting(self) -> Collection[str]:
        """Return the only peer, unless the line is lost."""
        return () if self._descriptor is None else (self._device,)

    def gone(self) -> list[str]:
        """Return the peer if the line has been lost since the last call."""
        gone, self._gone = self._gone, []
        return gone

    def receive(self) -> list[ReceivedBytes]:
        """Return the bytes that have arrived.

        A line may be a radio, so its client counts as another machine.
        """
        if self._descriptor is None:
            return []
        try:
            data = os.read(self._descriptor, MAX_SERIAL_READ)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._lose()
            return []
        return [ReceivedBytes(self._device, data, is_loopback=False)]

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send a frame, or keep it if the line is full, or drop it."""
        if self._descriptor is None:
            return
        try:
            self._buffer.add(data, is_stream=is_stream)
        except OSError:
            self._lose()

    def flush(self, now_ns: int) -> None:
        """Send the waiting frames; once per second, try to open a lost line again."""
        if self._descriptor is None:
            if now_ns - self._tried_ns >= REOPEN_NS:
                self._tried_ns = now_ns
                with suppress(OSError, termios.error):
                    self._open()
            return
        try:
            self._buffer.flush()
        except OSError:
            self._lose()

    def forget(self, peer: str) -> None:
        """Do nothing: the line stays."""

    def close(self) -> None:
        """Close the line."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def _lose(self) -> None:
        self.close()
        self._gone.append(self._device)


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
    place, _, number = rest.rpartition(":")
    form, example = "HOST:PORT", EXAMPLE.replace("udpin", kind)
    if kind == SERIAL:
        form, example = "DEVICE:BAUD", "serial:/dev/ttyUSB0:57600"
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
