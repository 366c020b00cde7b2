"""TCP endpoint: `tcpin:HOST:PORT` serves each client that connects."""

import socket
from collections.abc import Collection
from contextlib import suppress
from typing import Final

from gateways.mavlink.endpoints.addresses import explained, is_loopback, name_of, resolved
from gateways.mavlink.endpoints.endpoint import MAX_PEERS, Received
from gateways.mavlink.endpoints.send_buffer import SendBuffer

MAX_READ: Final = 16_384
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

    def receive(self) -> list[Received]:
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
                data = one.socket.recv(MAX_READ)
            except BlockingIOError:
                continue
            except OSError:
                data = b""
            if data:
                found.append(Received(peer, data, one.is_loopback))
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
