"""UDP endpoints: `udpin:HOST:PORT` answers whoever sends, `udpout:HOST:PORT` begins to send."""

import socket
from contextlib import suppress
from ipaddress import ip_address
from typing import Final

from ground.gateway.endpoints.endpoint import Received
from runtime.errors import UserError

LARGEST: Final = 65_535
MAX_READ: Final = 256
"""Datagrams read in one round, so that a flood cannot hold up the vehicles."""


class UdpEndpoint:
    """A UDP socket. `listens`: it is bound to the address, otherwise that is its only peer."""

    def __init__(self, text: str, host: str, port: int, *, listens: bool) -> None:
        self.text = text
        self._addresses: dict[str, tuple[str, int]] = {}
        try:
            address = (socket.gethostbyname(host), port)
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
            if listens:
                self._socket.bind(address)
        except OSError as error:
            raise UserError(f"{text}: {error.strerror or error}") from error
        self._fixed = None if listens else _name(address)
        if self._fixed is not None:
            self._addresses[self._fixed] = address

    @property
    def port(self) -> int:
        """The real port, if 0 was given."""
        return int(self._socket.getsockname()[1])

    @property
    def fixed_peer(self) -> str | None:
        """The peer to send to before anything has been received from it."""
        return self._fixed

    def filenos(self) -> list[int]:
        """Return the descriptor."""
        return [self._socket.fileno()]

    def receive(self) -> list[Received]:
        """Return the datagrams that have arrived, at most MAX_READ."""
        found = []
        with suppress(OSError):
            for _ in range(MAX_READ):
                data, address = self._socket.recvfrom(LARGEST)
                peer = _name(address)
                self._addresses[peer] = address
                found.append(Received(peer, data, ip_address(address[0]).is_loopback))
        return found

    def send(self, peer: str, data: bytes) -> None:
        """Send one datagram; drop it if the socket's buffer is full."""
        address = self._addresses.get(peer)
        if address is not None:
            with suppress(OSError):
                self._socket.sendto(data, address)

    def forget(self, peer: str) -> None:
        """Drop the address of a client that has gone."""
        if peer != self._fixed:
            self._addresses.pop(peer, None)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _name(address: tuple[str, int]) -> str:
    return f"{address[0]}:{address[1]}"
