"""Close links without lingering.

Zenoh 1.10 sets SO_LINGER to 10 s on each TCP link (eclipse-zenoh/zenoh#2350): where the other end
does not read, closing it blocks one of the few threads that take in what everybody else sends.
Zenoh has no setting for it, so it is taken back on each link's socket.
"""

import errno
import os
import socket
import struct
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread
from typing import Final

DESCRIPTORS: Final = Path("/proc/self/fd")
OFF: Final = struct.pack("ii", 0, 0)
STREAMS: Final = (socket.AF_INET, socket.AF_INET6)
NO_DESCRIPTOR: Final = (errno.EMFILE, errno.ENFILE)
AGAIN_S: Final = 0.1
"""Pause before the next attempt when there was no descriptor left for this one."""


def stop_lingering() -> None:
    """Have no TCP socket of this process wait when it is closed. Works on Linux.

    Raises OSError when no descriptor is left to do it with.
    """
    for descriptor in sockets():
        try:
            stop_lingering_of(descriptor)
        except OSError as error:  # closed meanwhile
            if error.errno in NO_DESCRIPTOR:
                raise


def stop_lingering_of(descriptor: int) -> None:
    """Have this socket not wait if it is one of TCP. Raises OSError."""
    with taken(os.dup(descriptor)) as one:
        if one.family in STREAMS and one.type == socket.SOCK_STREAM:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, OFF)


def sockets() -> list[int]:
    """Return the descriptors of this process that are sockets."""
    found = []
    for entry in tuple(DESCRIPTORS.iterdir()) if DESCRIPTORS.is_dir() else ():
        with suppress(OSError):
            if os.readlink(entry).startswith("socket:"):
                found.append(int(entry.name))
    return found


def taken(descriptor: int) -> socket.socket:
    """Return the socket of a descriptor; closes what is none. Raises OSError."""
    try:
        return socket.socket(fileno=descriptor)
    except OSError:
        os.close(descriptor)
        raise


class DelayedClose:
    """Does that in a thread of its own, as there may be hundreds; `stop` may be called anywhere."""

    def __init__(self) -> None:
        self._wanted = Event()
        self._closed = Event()
        self._thread: Thread | None = None

    def stop(self, *_: object) -> None:
        """Take it back soon on all sockets there are now."""
        self._wanted.set()
        if self._thread is None and not self._closed.is_set():
            self._thread = Thread(target=self._run, name="linger", daemon=True)
            self._thread.start()

    def close(self) -> None:
        self._closed.set()
        self._wanted.set()
        if self._thread is not None:
            self._thread.join(timeout=1.0)

    def _run(self) -> None:
        while not self._closed.is_set():
            self._wanted.wait()
            self._wanted.clear()
            try:
                stop_lingering()
            except OSError:  # a flood of connections holds all descriptors
                self._wanted.set()
                self._closed.wait(AGAIN_S)
