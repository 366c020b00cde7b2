"""A UDP relay between clients and a server, with an impaired line in each direction."""

import os
import selectors
import socket
import threading
from contextlib import ExitStack, suppress
from time import monotonic_ns
from typing import Final, NamedTuple, Self

from checks.relay.impairment import ImpairedLine, Impairment
from runtime.units import NS_PER_S

LARGEST: Final = 65_535
MAX_READ: Final = 64
IDLE_S: Final = 1.0

Address = tuple[str, int]


class Peer(NamedTuple):
    """A client: its address, the socket that represents it at the server, and its two lines."""

    address: Address
    upstream: socket.socket
    up: ImpairedLine
    down: ImpairedLine


class UdpRelay:
    """Forwards datagrams of clients from `port` to the server, and its answers back."""

    def __init__(self, server: Address, impairment: Impairment, seed: int) -> None:
        self.peers: dict[Address, Peer] = {}
        self._server = server
        self._impairment = impairment
        self._seed = seed
        self._scope = ExitStack()
        self._selector = self._scope.enter_context(selectors.DefaultSelector())
        self._listener = self._socket()
        self._listener.bind(("127.0.0.1", 0))
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._end_read, self._end_write = os.pipe()
        for descriptor in (self._end_read, self._end_write):
            self._scope.callback(os.close, descriptor)
        self._selector.register(self._end_read, selectors.EVENT_READ, "end")
        self.port: int = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        os.write(self._end_write, b"x")
        self._thread.join()
        self._scope.close()

    def _run(self) -> None:
        while True:
            for key, _ in self._selector.select(self._wait_s()):
                if key.data == "end":
                    return
                self._receive(key.data)
            self._forward(monotonic_ns())

    def _wait_s(self) -> float:
        lines = (line for peer in self.peers.values() for line in (peer.up, peer.down))
        due = [line.due_ns for line in lines if line.due_ns is not None]
        return max(0.0, (min(due) - monotonic_ns()) / NS_PER_S) if due else IDLE_S

    def _receive(self, peer: Peer | None) -> None:
        with suppress(OSError):  # no datagram is left, or the other end does not exist
            for _ in range(MAX_READ):
                if peer is None:
                    data, address = self._listener.recvfrom(LARGEST)
                    self._peer(address).up.put(data, monotonic_ns())
                else:
                    peer.down.put(peer.upstream.recv(LARGEST), monotonic_ns())

    def _forward(self, now_ns: int) -> None:
        for peer in self.peers.values():
            for data in peer.up.take(now_ns):
                with suppress(OSError):
                    peer.upstream.send(data)
            for data in peer.down.take(now_ns):
                with suppress(OSError):
                    self._listener.sendto(data, peer.address)

    def _peer(self, address: Address) -> Peer:
        found = self.peers.get(address)
        if found is None:
            upstream = self._socket()
            upstream.connect(self._server)
            seed = self._seed + 2 * len(self.peers)
            lines = (ImpairedLine(self._impairment, seed + way) for way in range(2))
            found = self.peers[address] = Peer(address, upstream, *lines)
            self._selector.register(upstream, selectors.EVENT_READ, found)
        return found

    def _socket(self) -> socket.socket:
        made = self._scope.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        made.setblocking(False)
        return made
