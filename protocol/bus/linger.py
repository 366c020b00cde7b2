"""Close links without lingering, and end the link of one peer.

Zenoh 1.10 sets SO_LINGER to 10 s on each TCP link (eclipse-zenoh/zenoh#2350). If the other end does
not read, closing the link blocks one of the few receive threads. Zenoh has no setting for it, so
this module clears the option on each link's socket. Zenoh's Python API cannot close a single link
either; its socket, which belongs to this process, can be shut down.
"""

import errno
import os
import socket
import struct
from collections import deque
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread
from typing import Final

from protocol.bus.tls.peer_address import ConnectionEnd, end_in, plain_host

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
