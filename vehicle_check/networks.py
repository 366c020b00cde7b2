"""Connections of the judge to one vehicle: UDP, TCP, and a serial line.

They also measure how long this machine has kept its processes waiting, which is not the vehicle's.
"""

import os
import selectors
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from ipaddress import ip_address
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from runtime.errors import RemoteError, UserError
from runtime.serial_line import SERIAL_EXAMPLE, open_first
from runtime.units import NS_PER_S, NS_PER_US

LARGEST: Final = 65_535
MAX_READ: Final = 64
MAX_WAITING: Final = 65_536
UDP_OUT: Final = "udpout"
UDP_IN: Final = "udpin"
TCP: Final = "tcp"
SERIAL: Final = "serial"
USAGE: Final = (
    f"use udpout:HOST:PORT, udpin:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD, "
    f"as in {SERIAL_EXAMPLE}"
)


class Heard(NamedTuple):
    """Bytes that the vehicle has sent to one peer."""

    peer: int
    data: bytes
    at_ns: int


class VehicleNetwork(Protocol):
    """Connections to one vehicle, numbered from 0."""

    @property
    def is_stream(self) -> bool:
        """True for connections that deliver without loss, such as TCP."""

    @property
    def is_shared(self) -> bool:
        """True if all peers share one line, so that each receives all that the vehicle sends."""

    @property
    def is_loopback(self) -> bool:
        """True if the vehicle is on this machine."""

    @property
    def held_up_ns(self) -> int:
        """For how long this machine has kept the judge waiting, or a vehicle that runs on it."""

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


class VehicleAddress(NamedTuple):
    """A parsed endpoint: its kind, host or device, and port or speed."""

    kind: str
    name: str
    number: int


def address_of(text: str) -> VehicleAddress:
    """Parse an endpoint; UserError names the error."""
    kind, _, rest = text.partition(":")
    name, colon, number = rest.rpartition(":")
    if kind not in (UDP_OUT, UDP_IN, TCP, SERIAL) or not (colon and name):
        raise UserError(f"endpoint {text!r}: {USAGE}")
    is_number = number.isascii() and number.isdecimal()
    if kind == SERIAL and not is_number:
        raise UserError(f"endpoint {text!r}: {number!r} is no speed in baud")
    if kind != SERIAL and not (is_number and 0 < int(number) < 65_536):
        raise UserError(f"endpoint {text!r}: {number!r} is no port (1 to 65535)")
    return VehicleAddress(kind, name, int(number))


def network_of(text: str) -> VehicleNetwork:
    """Return the network of an endpoint, without a connection; UserError names what is wrong."""
    address = address_of(text)
    if address.kind == SERIAL:
        return SerialNetwork(text, address)
    return SocketNetwork(text, address)


PRESSURE: Final = Path("/proc/pressure/cpu")
RUN_DELAY: Final = Path("/proc/self/schedstat")


def waited_ns(*, anywhere: bool) -> int:
    """Return for how long ready tasks have waited for a processor so far.

    Those of the whole machine with `anywhere`, else this process. 0 if the system does not count
    it: then nothing is charged to the machine.
    """
    try:
        if anywhere:
            some = PRESSURE.read_text(encoding="ascii").splitlines()[0]
            return int(some.rpartition("total=")[2]) * NS_PER_US
        return int(RUN_DELAY.read_text(encoding="ascii").split()[1])
    except (OSError, ValueError, IndexError):
        return 0


class _Selected:
    """What sockets and serial lines share: the time, waiting, and the load of this machine."""

    is_loopback = False

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()

    @property
    def held_up_ns(self) -> int:
        """For how long this machine has kept ready tasks waiting for a processor."""
        return waited_ns(anywhere=self.is_loopback)

    def now_ns(self) -> int:
        """Return the monotonic time."""
        return time.monotonic_ns()

    def receive(self, until_ns: int) -> list[Heard]:
        """Wait for bytes of any connection."""
        wait_s = max(0, until_ns - self.now_ns()) / NS_PER_S
        found: list[Heard] = []
        for key, _ in self._selector.select(wait_s):
            read: Callable[[], list[Heard]] = key.data
            found += read()
        return found


class SocketNetwork(_Selected):
    """Connections over UDP or TCP.

    With `udpin` the first connection listens; the others send to the vehicle's address from ports
    of their own.
    """

    is_shared = False

    def __init__(self, text: str, address: VehicleAddress) -> None:
        super().__init__()
        self._text = text
        self._address = address
        self._sockets: list[socket.socket] = []
        self._vehicle: tuple[str, int] | None = None
        try:
            self._host = socket.gethostbyname(address.name)
        except OSError as error:
            raise UserError(f"endpoint {text!r}: {error.strerror or error}") from error
        self.is_stream = address.kind == TCP
        """True for TCP."""
        self.is_loopback = ip_address(self._host).is_loopback
        """True for an address of this machine only."""

    def open(self) -> int:
        """Open one more connection; UserError or RemoteError if that fails."""
        number = len(self._sockets)
        kind = socket.SOCK_STREAM if self.is_stream else socket.SOCK_DGRAM
        made = socket.socket(socket.AF_INET, kind)
        target = (self._host, self._address.number)
        try:
            if self.is_stream:
                made.settimeout(3)
                made.connect(target)
            elif self._address.kind == UDP_IN and not number:
                made.bind(target)
        except OSError as error:
            made.close()
            kind_of_error = RemoteError if self.is_stream else UserError
            raise kind_of_error(f"{self._text}: {error.strerror or error}") from error
        made.setblocking(False)
        self._sockets.append(made)
        self._selector.register(made, selectors.EVENT_READ, lambda: self._read(number, made))
        return number

    def send(self, peer: int, data: bytes) -> None:
        """Send bytes; drop them if the vehicle's address is not known or the buffer is full."""
        with suppress(OSError):
            if self.is_stream:
                self._sockets[peer].send(data)
                return
            target: tuple[str, int] | None = (self._host, self._address.number)
            if self._address.kind == UDP_IN:
                target = self._vehicle
            if target is not None:
                self._sockets[peer].sendto(data, target)

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


class SerialNetwork(_Selected):
    """A serial line, which all ground stations share."""

    is_stream = True
    is_shared = True

    def __init__(self, text: str, address: VehicleAddress) -> None:
        super().__init__()
        self._descriptor = open_first(text, address.name, address.number)
        self._text = text
        self._waiting = bytearray()
        self._peers = 0
        self._is_open = True
        self._selector.register(self._descriptor, selectors.EVENT_READ, self._read)

    def open(self) -> int:
        """Count one more ground station."""
        self._peers += 1
        return self._peers - 1

    def send(self, peer: int, data: bytes) -> None:
        """Send bytes, when the line has room for them; drop them if it is far behind."""
        if self._is_open and len(self._waiting) + len(data) <= MAX_WAITING:
            self._waiting += data
            self._write()

    def receive(self, until_ns: int) -> list[Heard]:
        """Wait for bytes; send what waits for room."""
        self._write()
        return super().receive(until_ns)

    def close(self) -> None:
        """Close the line."""
        self._selector.close()
        os.close(self._descriptor)

    def _write(self) -> None:
        if self._waiting and self._is_open:
            with suppress(BlockingIOError):
                del self._waiting[: os.write(self._descriptor, self._waiting)]

    def _read(self) -> list[Heard]:
        try:
            data = os.read(self._descriptor, LARGEST)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            # An adapter that was unplugged: the vehicle is silent from now on.
            self._is_open = False
            self._selector.unregister(self._descriptor)
            return []
        return [Heard(0, data, self.now_ns())]
