"""Close links without lingering.

Zenoh 1.10 sets SO_LINGER to 10 s on each TCP link (eclipse-zenoh/zenoh#2350). If the other end does
not read, closing the link blocks one of the few receive threads. Zenoh has no setting for it, so
this module clears the option on each link's socket.
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
"""Pause before the next attempt if no descriptor was left."""


def stop_lingering() -> None:
    """Clear SO_LINGER on all TCP sockets of this process. Works on Linux.

    Raises OSError if no file descriptor is left for the operation.
    """
    for descriptor in sockets():
        try:
            stop_lingering_of(descriptor)
        except OSError as error:  # another thread has closed the socket
            if error.errno in NO_DESCRIPTOR:
                raise


def stop_lingering_of(descriptor: int) -> None:
    """Clear SO_LINGER on a socket if it is a TCP socket. Raises OSError."""
    with socket_of(os.dup(descriptor)) as one:
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


def socket_of(descriptor: int) -> socket.socket:
    """Return the socket of a descriptor; close a descriptor that is no socket. Raises OSError."""
    try:
        return socket.socket(fileno=descriptor)
    except OSError:
        os.close(descriptor)
        raise


class DelayedClose:
    """Clear SO_LINGER in a separate thread: there may be hundreds of sockets."""

    def __init__(self) -> None:
        self._wanted = Event()
        self._closed = Event()
        self._thread: Thread | None = None

    def stop(self, *_: object) -> None:
        """Request clearing SO_LINGER on all present sockets; may be called from any thread."""
        self._wanted.set()
        if self._thread is None and not self._closed.is_set():
            self._thread = Thread(target=self._run, name="linger", daemon=True)
            self._thread.start()

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
            try:
                stop_lingering()
            except OSError:  # a flood of connections holds all descriptors
                self._wanted.set()
                self._closed.wait(AGAIN_S)
