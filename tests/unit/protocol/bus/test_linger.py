"""Closed links do not linger, and a shortage of file descriptors ends no thread."""

import errno
import os
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from resource import RLIMIT_NOFILE, getrlimit, setrlimit

import pytest

from protocol.bus import sockets
from protocol.bus.sockets import LinkCloser, stop_lingering
from tests.support.until import until

LINGER = struct.pack("ii", 1, 10)


def lingers(one: socket.socket) -> bool:
    return one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)[0] != 0


@pytest.fixture
def lingering() -> Iterator[socket.socket]:
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER)
        yield one
        one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, sockets.OFF)


@contextmanager
def no_descriptor_left() -> Iterator[None]:
    """Prevent this process from opening more files."""
    limits = getrlimit(RLIMIT_NOFILE)
    top = max(map(int, os.listdir("/proc/self/fd")))
    held: list[int] = []
    setrlimit(RLIMIT_NOFILE, (top + 1, limits[1]))
    try:
        with suppress(OSError):
            while True:
                held.append(os.dup(0))
        yield
    finally:
        setrlimit(RLIMIT_NOFILE, limits)
        for one in held:
            os.close(one)


def test_shortage_of_descriptors_is_raised(lingering: socket.socket) -> None:
    with no_descriptor_left(), pytest.raises(OSError, match="Too many open files"):
        stop_lingering()
    assert lingers(lingering)
    stop_lingering()
    assert not lingers(lingering)


def test_socket_that_cannot_be_copied_counts_as_open(
    lingering: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    def dup(_: int) -> int:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(os, "dup", dup)
    with pytest.raises(OSError, match="Too many open files"):
        stop_lingering()
    assert lingers(lingering)


def test_linger_is_cleared_once_descriptors_are_available(
    lingering: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise each link closed later blocks the subscribers for up to 10 s."""
    calls: list[str] = []
    real = sockets.stop_lingering

    def stop() -> None:
        calls.append("stop")
        if len(calls) == 1:
            raise OSError(errno.EMFILE, "Too many open files")
        real()

    monkeypatch.setattr(sockets, "stop_lingering", stop)
    one = LinkCloser()
    one.stop_lingering()
    until(lambda: not lingers(lingering), what="the second attempt")
    one.close()
