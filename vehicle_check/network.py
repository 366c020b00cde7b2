"""Connections of the judge to a vehicle: several peers of one endpoint, over sockets."""

import random
import selectors
import socket
import time
from contextlib import suppress
from ipaddress import ip_address
from typing import Final, NamedTuple, Protocol

from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_S

LARGEST: Final = 65_535
MAX_READ: Final = 64
KINDS: Final = ("udpout", "udpin", "tcp")
USAGE: Final = "use udpout:HOST:PORT, udpin:HOST:PORT or tcp:HOST:PORT"


class Heard(NamedTuple):
    """Bytes that the vehicle has sent to one peer."""

    peer: int
    data: bytes
    at_ns: int


class Network(Protocol):
    """Connections to one vehicle, numbered from 0."""

    @property
    def is_stream(self) -> bool:
        """True for connections that deliver without loss, such as TCP."""

    @property
    def is_loopback(self) -> bool:
        """True if the vehicle is on this machine."""

    def now_ns(self) -> int:
        """Return the time."""

    def open(self) -> int:
        """Open one more connection; return its number."""

    def send(self, peer: int, data: bytes) -> None:
        """Send bytes to the vehicle."""

    def receive(self, until_ns: int) -> list[Heard]:
        """Wait for bytes, at most until a time; return all bytes that have arrived."""

    def close(self) -> None:
        """Close all connections."""


class Address(NamedTuple):
    """A parsed endpoint."""

    kind: str
    host: str
    port: int


def address_of(text: str) -> Address:
    """Parse an endpoint; UserError names the error."""
    kind, _, rest = text.partition(":")
    host, colon, port = rest.rpartition(":")
    if kind not in KINDS or not (colon and host):
        raise UserError(f"endpoint {text!r}: {USAGE}")
    if not (port.isdecimal() and 0 < int(port) < 65_536):
        raise UserError(f"endpoint {text!r}: {port!r} is no port (1 to 65535)")
    return Address(kind, host, int(port))


class SocketNetwork:
    """Connections over UDP or TCP.

    With `udpin` the first connection listens; the others send to the vehicle's address from ports
    of their own.
    """

    def __init__(self, text: str) -> None:
        self._text = text
        self._address = address_of(text)
        self._sockets: list[socket.socket] = []
        self._vehicle: tuple[str, int] | None = None
        self._selector = selectors.DefaultSelector()
        try:
            self._host = socket.gethostbyname(self._address.host)
        except OSError as error:
            raise UserError(f"endpoint {text!r}: {error.strerror or error}") from error

    @property
    def is_stream(self) -> bool:
        """True for TCP."""
        return self._address.kind == "tcp"

    @property
    def is_loopback(self) -> bool:
        """True for an address of this machine only."""
        return ip_address(self._host).is_loopback

    def now_ns(self) -> int:
        """Return the monotonic time."""
        return time.monotonic_ns()

    def open(self) -> int:
        """Open one more connection; UserError or RemoteError if that fails."""
        number = len(self._sockets)
        kind = socket.SOCK_STREAM if self.is_stream else socket.SOCK_DGRAM
        made = socket.socket(socket.AF_INET, kind)
        target = (self._host, self._address.port)
        try:
            if self.is_stream:
                made.settimeout(3)
                made.connect(target)
            elif self._address.kind == "udpin" and not number:
                made.bind(target)
        except OSError as error:
            made.close()
            kind_of_error = RemoteError if self.is_stream else UserError
            raise kind_of_error(f"{self._text}: {error.strerror or error}") from error
        made.setblocking(False)
        self._sockets.append(made)
        self._selector.register(made, selectors.EVENT_READ, number)
        return number

    def send(self, peer: int, data: bytes) -> None:
        """Send bytes; drop them if the vehicle's address is not known or the buffer is full."""
        with suppress(OSError):
            if self.is_stream:
                self._sockets[peer].send(data)
                return
            target: tuple[str, int] | None = (self._host, self._address.port)
            if self._address.kind == "udpin":
                target = self._vehicle
            if target is not None:
                self._sockets[peer].sendto(data, target)

    def receive(self, until_ns: int) -> list[Heard]:
        """Wait for bytes of any connection."""
        wait_s = max(0, until_ns - self.now_ns()) / NS_PER_S
        found: list[Heard] = []
        for key, _ in self._selector.select(wait_s):
            assert isinstance(key.fileobj, socket.socket)
            found += self._read(key.data, key.fileobj)
        return found

    def close(self) -> None:
        """Close all sockets."""
        self._selector.close()
        for one in self._sockets:
            one.close()

    def _read(self, peer: int, one: socket.socket) -> list[Heard]:
        found: list[Heard] = []
        with suppress(BlockingIOError, InterruptedError, ConnectionRefusedError):
            for _ in range(MAX_READ):
                data, sender = self._received(one)
                if not data and self.is_stream:
                    self._selector.unregister(one)
                    break
                if sender is not None and peer == 0:
                    self._vehicle = sender
                found.append(Heard(peer, data, self.now_ns()))
        return found

    def _received(self, one: socket.socket) -> tuple[bytes, tuple[str, int] | None]:
        if not self.is_stream:
            return one.recvfrom(LARGEST)
        try:
            return one.recv(LARGEST), None
        except ConnectionError:
            return b"", None


class Losses:
    """Selects the frames to drop, by a seed."""

    def __init__(self, share: float, seed: int) -> None:
        self.share = share
        self._random = random.Random(seed)

    def drops(self) -> bool:
        """Return True for a frame to drop."""
        return self.share > 0 and self._random.random() < self.share
