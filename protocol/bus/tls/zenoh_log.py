"""Capture Zenoh's own log, which it can only write to standard output, in a bounded channel.

Each event of the log is one datagram to a socket of this process on the loopback interface. The
kernel keeps the boundaries between events, cuts an event at MAX_EVENT_BYTES and drops events when
the socket buffer is full. A write never waits and never fails for lack of space. A pipe would block
reception on the bus, a file in memory would grow, and a line break inside a key would start a new
line.
"""

import os
import socket
import sys
from collections import deque
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Self

import zenoh

from runtime.cli.terminal import guarded

AUDIT_FILTER: Final = "zenoh::net::routing::interceptor::access_control=trace,zenoh_link_tls=debug"
ENVIRONMENT: Final[Mapping[str, str | None]] = MappingProxyType({"RUST_LOG": None, "NO_COLOR": "1"})
"""Environment variables that Zenoh's log reads, with the values set for it."""

STDOUT: Final = 1
LOOPBACK: Final = "127.0.0.1"
BUFFER_BYTES: Final = 1 << 20
"""Requested buffer size; the kernel may grant less."""

MAX_EVENT_BYTES: Final = 600
MAX_READ: Final = 500
"""Events read in one call of `drain`: bounds its cost in a flood."""

MAX_KEPT: Final = 300
"""Events kept between two calls of `take`."""


class ZenohLog:
    """Capture Zenoh's log until `close`. Python's own standard output is not affected.

    Only events that contain one of `signs` are kept; without signs, all are.
    """

    def __init__(self, wanted: str = AUDIT_FILTER, signs: tuple[bytes, ...] = ()) -> None:
        self._signs = signs
        self._kept: deque[bytes] = deque(maxlen=MAX_KEPT)
        self._reader, self._writer = channel()
        sys.stdout.flush()
        sys.stdout = guarded(os.fdopen(os.dup(STDOUT), "w", buffering=1))
        os.dup2(self._writer.fileno(), STDOUT)
        initialise(wanted)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def drain(self) -> None:
        """Read up to MAX_READ events from the kernel, and keep those that contain a sign."""
        for _ in range(MAX_READ):
            try:
                event = self._reader.recv(MAX_EVENT_BYTES)
            except BlockingIOError:
                return
            if not self._signs or any(sign in event for sign in self._signs):
                self._kept.append(event)

    def take(self) -> list[bytes]:
        """Return the events kept since the last call, the newest MAX_KEPT of them."""
        self.drain()
        kept = list(self._kept)
        self._kept.clear()
        return kept

    def close(self) -> None:
        """End the capture. Zenoh's log cannot be closed: later output is discarded.

        Python's own standard output continues on its separate descriptor.
        """
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, STDOUT)
        os.close(nowhere)
        self._writer.close()
        self._reader.close()


def channel() -> tuple[socket.socket, socket.socket]:
    """Return a reader and a writer of datagrams that accept nothing from any other socket."""
    reader = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    writer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for end in (reader, writer):
        end.bind((LOOPBACK, 0))
        end.setblocking(False)
    reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    reader.connect(writer.getsockname())
    writer.connect(reader.getsockname())
    return reader, writer


def initialise(wanted: str) -> None:
    """Start Zenoh's log, once per process, independent of the environment."""
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    set_all(ENVIRONMENT)
    try:
        zenoh.init_log_from_env_or(wanted)
    finally:
        set_all(before)


def set_all(values: Mapping[str, str | None]) -> None:
    """Set or remove environment variables."""
    for name, value in values.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
