"""UDP endpoints: `udpin:HOST:PORT` waits for clients, `udpout:HOST:PORT` sends first."""

import socket
from collections.abc import Collection
from contextlib import suppress
from typing import Final

from gateways.mavlink.endpoints.addresses import Address, explained, is_loopback, name_of, resolved
from gateways.mavlink.endpoints.endpoint import MAX_PEERS, Received

LARGEST: Final = 65_535
MAX_READ: Final = 256
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

    def receive(self) -> list[Received]:
        """Return the datagrams that have arrived, at most MAX_READ, of at most MAX_PEERS peers."""
        found = []
        for _ in range(MAX_READ):
            try:
                data, address = self._socket.recvfrom(LARGEST)
            except BlockingIOError:
                break
            except OSError:
                continue
            peer = name_of(address)
            if self._admits(peer):
                self._addresses[peer] = address
                found.append(Received(peer, data, is_loopback(address)))
        return found

    def _admits(self, peer: str) -> bool:
        if peer in self._addresses:
            return True
        if self._fixed or len(self._addresses) >= MAX_PEERS + MAX_READ:
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
