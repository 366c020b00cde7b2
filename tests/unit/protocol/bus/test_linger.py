"""Links that do not linger: no shortage of descriptors ends the thread that sees to it."""

import errno
import os
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from resource import RLIMIT_NOFILE, getrlimit, setrlimit

import pytest

from protocol.bus import linger
from protocol.bus.linger import DelayedClose, stop_lingering
from tests.support.until import until

LINGER = struct.pack("ii", 1, 10)


def lingers(one: socket.socket) -> bool:
    return one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)[0] != 0


@pytest.fixture
def lingering() -> Iterator[socket.socket]:
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER)
        yield one
        one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger.OFF)


@contextmanager
def no_descriptor_left() -> Iterator[None]:
    """Let this process open no further file."""
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


def test_a_socket_that_cannot_be_copied_is_no_closed_one(
    lingering: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    def dup(_: int) -> int:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(os, "dup", dup)
    with pytest.raises(OSError, match="Too many open files"):
        stop_lingering()
    assert lingers(lingering)


def test_after_a_shortage_of_descriptors_it_is_done_as_soon_as_there_are_some(
    lingering: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each link closed from then on blocked those who listen, for up to 10 s."""
    calls: list[str] = []
    real = linger.stop_lingering

    def stop() -> None:
        calls.append("stop")
        if len(calls) == 1:
            raise OSError(errno.EMFILE, "Too many open files")
        real()

    monkeypatch.setattr(linger, "stop_lingering", stop)
    one = DelayedClose()
    one.stop()
    until(lambda: not lingers(lingering), what="the second attempt")
    one.close()
