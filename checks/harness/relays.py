"""Bad lines between two programs: TCP proxies that are cut or slow, and UDP with an impaired line.

A line is impaired by seeded loss, delay, jitter and reordering, without I/O. A TCP connection to
the hub is cut silently.
"""

import os
import selectors
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from heapq import heappop, heappush
from queue import SimpleQueue
from random import Random
from time import monotonic_ns
from typing import Final, NamedTuple, Self

from runtime.units import NS_PER_MS, NS_PER_S

CHUNK: Final = 1024
BUFFER: Final = 4096
"""Size of the receive buffer of a slow line: the system grants at least this."""


class TcpProxy:
    """Forwards bytes both ways; once cut it forwards nothing and accepts no connections.

    With `bytes_per_s` those from the far end pass at this rate. `delay_s` is that of each way.
    """

    def __init__(self, endpoint: str, bytes_per_s: float = 0.0, delay_s: float = 0.0) -> None:
        self.accepted = 0
        """How many connections were accepted so far."""
        self._pause_s = CHUNK / bytes_per_s if bytes_per_s else 0.0
        self._delay_ns = round(delay_s * NS_PER_S)
        self._closing = threading.Event()
        protocol = endpoint.partition("/")[0]
        self._far = address_of(endpoint)
        self._sockets = ExitStack()
        self._fillers = ExitStack()
        self._whole = threading.Event()
        self._whole.set()
        self._listener = self._listening(0, backlog=5)
        self._port = self._listener.getsockname()[1]
        self.endpoint = f"{protocol}/127.0.0.1:{self._port}"
        threading.Thread(target=self._accept_connections, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._fillers.close()
        close_socket(self._listener)
        self._sockets.close()

    def cut(self) -> None:
        """Forward nothing from now on; with its backlog full, connection attempts time out."""
        self._whole.clear()
        close_socket(self._listener)
        self._listener = self._listening(self._port, backlog=0)
        for _ in range(4):
            filler = self._fillers.enter_context(socket.socket())
            filler.setblocking(False)
            with suppress(BlockingIOError):
                filler.connect(("127.0.0.1", self._port))

    def redirect(self, endpoint: str) -> None:
        """Close all connections, and connect clients to `endpoint` from now on."""
        self._far = address_of(endpoint)
        self._sockets.close()

    def restore(self) -> None:
        """Forward and accept connections again."""
        self._fillers.close()
        close_socket(self._listener)
        self._listener = self._listening(self._port, backlog=5)
        self._whole.set()
        threading.Thread(target=self._accept_connections, daemon=True).start()

    @staticmethod
    def _listening(port: int, *, backlog: int) -> socket.socket:
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", port))
        listener.listen(backlog)
        return listener

    def _accept_connections(self) -> None:
        listener = self._listener
        with suppress(OSError):
            while True:
                near, _ = listener.accept()
                self.accepted += 1
                far = socket.socket()
                if self._pause_s:
                    far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
                try:
                    far.connect(self._far)
                except OSError:  # the far end refuses, so the client is refused too
                    close_socket(near)
                    far.close()
                    continue
                for end in (near, far):
                    end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._sockets.callback(close_socket, end)
                for way in ((near, far, 0.0), (far, near, self._pause_s)):
                    threading.Thread(target=self._forward, args=way, daemon=True).start()

    def _forward(self, source: socket.socket, sink: socket.socket, pause_s: float) -> None:
        with suppress(OSError):
            for data in self._delayed(source) if self._delay_ns else read(source, pause_s):
                if self._whole.is_set():
                    sink.sendall(data)
                if pause_s:
                    self._closing.wait(pause_s)
        with suppress(OSError):  # also after an error: each end learns that the other one has gone
            sink.shutdown(socket.SHUT_RDWR)

    def _delayed(self, source: socket.socket) -> Iterator[bytes]:
        """Yield what is read, each time after the delay; another thread reads meanwhile."""
        under_way = SimpleQueue[tuple[int, bytes]]()

        def fill() -> None:
            with suppress(OSError):
                for data in read(source, 0.0):
                    under_way.put((monotonic_ns() + self._delay_ns, data))
            under_way.put((monotonic_ns() + self._delay_ns, b""))

        threading.Thread(target=fill, daemon=True).start()
        while True:
            due_ns, data = under_way.get()
            self._closing.wait(max(0, due_ns - monotonic_ns()) / NS_PER_S)
            if not data:
                return
            yield data


def read(source: socket.socket, pause_s: float) -> Iterator[bytes]:
    """Yield what arrives until the connection is closed; little at a time if there is a pause."""
    while data := source.recv(CHUNK if pause_s else 65_536):
        yield data


def address_of(endpoint: str) -> tuple[str, int]:
    """Return host and port of an endpoint such as tcp/127.0.0.1:7447."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    return host, int(port)


def close_socket(end: socket.socket) -> None:
    """Close a socket and wake the threads that wait on it."""
    with suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)
    end.close()


OVERTAKEN_NS: Final = 30 * NS_PER_MS
"""Extra delay of a reordered datagram, so that later datagrams arrive before it."""


class Impairment(NamedTuple):
    """The properties of one direction; probabilities are between 0 and 1."""

    loss: float = 0.0
    delay_ns: int = 0
    jitter_ns: int = 0
    reordered: float = 0.0


PERFECT: Final = Impairment()
POOR: Final = Impairment(0.2, 50 * NS_PER_MS, 20 * NS_PER_MS, 0.1)
"""20 % loss, 50 ms delay, and every tenth datagram out of order."""


class ImpairedLine:
    """One direction. Equal datagrams with an equal seed have equal results."""

    def __init__(self, impairment: Impairment, seed: int) -> None:
        self.lost = self.passed = 0
        self._impairment = impairment
        self._random = Random(seed)
        self._number = 0
        self._in_order_ns = 0
        self._waiting: list[tuple[int, int, bytes]] = []

    @property
    def due_ns(self) -> int | None:
        """When the next datagram arrives; None if none is under way."""
        return self._waiting[0][0] if self._waiting else None

    def put(self, data: bytes, now_ns: int) -> None:
        """Send a datagram into the line."""
        self._number += 1
        # The same number of draws for each, so that one property does not change the others.
        loss, jitter, reordered = (self._random.random() for _ in range(3))
        if loss < self._impairment.loss:
            self.lost += 1
            return
        due_ns = now_ns + self._impairment.delay_ns + round(jitter * self._impairment.jitter_ns)
        if reordered < self._impairment.reordered:
            due_ns += OVERTAKEN_NS
        else:  # jitter alone does not change the order
            due_ns = self._in_order_ns = max(due_ns, self._in_order_ns)
        heappush(self._waiting, (due_ns, self._number, data))

    def take(self, now_ns: int) -> list[bytes]:
        """Return the datagrams that have arrived, in the order of their arrival."""
        found = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            found.append(heappop(self._waiting)[2])
        self.passed += len(found)
        return found


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
