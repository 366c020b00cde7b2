"""The door completes no connection that begins unlike TLS, and limits who fails too often."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from ipaddress import ip_address
from types import SimpleNamespace

import pytest

from protocol.bus import door
from protocol.bus.door import (
    BURST,
    LEAST_SHARE,
    UNAVAILABLE,
    UNPRIVILEGED,
    Door,
    Limits,
)
from protocol.bus.sockets import (
    SO_ATTACH_FILTER,
    SO_ATTACH_REUSEPORT_CBPF,
    Step,
    attach,
    choice_steps,
)
from tests.support.each import each
from tests.support.until import PATIENCE_S, until

HELLO = bytes.fromhex("1603010200010001fc0303")
HERE, THERE = "127.0.0.1", "127.0.0.2"
ADA, EVE = ip_address("10.0.0.7"), ip_address("10.0.0.66")


@contextmanager
def guarded(host: str = HERE) -> Iterator[tuple[socket.socket, Door, list[str]]]:
    """Return a listening socket with a door, and what the door reports."""
    said: list[str] = []
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.create_server((host, 0), family=family) as listener:
        listener.settimeout(PATIENCE_S)
        one = Door([listener.getsockname()[1]], said.append)
        try:
            yield listener, one, said
        finally:
            one.close()


def dial(listener: socket.socket, first: bytes, source: str = "") -> socket.socket:
    """Connect, and send these bytes at once."""
    near = (source, 0) if source else None
    one = socket.create_connection(listener.getsockname()[:2], PATIENCE_S, near)
    one.sendall(first)
    return one


@pytest.fixture
def stopped_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no time pass for the door: a share grows with it, and a busy machine is slow."""
    monkeypatch.setattr(door, "time", SimpleNamespace(monotonic=lambda: 0.0))


@each("host", [HERE, "::1"])
@each("bytes_sent", [b"", b"this is no TLS 123", b"GET / HTTP/1.1\r\n\r\n", b"\x00", b"\x16"])
def test_only_a_tls_record_completes_a_connection(host: str, bytes_sent: bytes) -> None:
    with guarded(host) as (listener, _, _):
        other = dial(listener, bytes_sent)
        other.close()
        with dial(listener, HELLO) as good:
            accepted, peer = listener.accept()
            with accepted:
                assert peer[:2] == good.getsockname()[:2], "the other came first"
                assert accepted.recv(100) == HELLO


def test_accepted_connection_is_free_of_the_filter() -> None:
    with guarded() as (listener, _, _), dial(listener, HELLO) as good:
        accepted, _ = listener.accept()
        with accepted:
            accepted.settimeout(PATIENCE_S)
            assert accepted.recv(100) == HELLO
            good.sendall(b"begins in the middle of a record")  # sent again until it is taken
            assert accepted.recv(100) == b"begins in the middle of a record"
            good.close()
            assert accepted.recv(100) == b""


def test_address_without_a_share_is_not_answered() -> None:
    with guarded() as (listener, _, _), socket.socket() as shut:
        steps = choice_steps({ip_address("::1"): 0.5, ip_address(THERE): 0.0})
        attach(listener, steps, SO_ATTACH_REUSEPORT_CBPF)
        dial(listener, HELLO, THERE).close()
        shut.bind((THERE, 0))
        shut.setblocking(False)
        assert shut.connect_ex(listener.getsockname()) != 0
        with dial(listener, HELLO) as good:
            accepted, peer = listener.accept()
            accepted.close()
            assert peer == good.getsockname()
        assert shut.connect_ex(listener.getsockname()) != 0, "it is still connecting"


@pytest.mark.usefixtures("stopped_clock")
def test_too_many_connections_without_a_link_are_reported() -> None:
    with guarded() as (listener, one, said):
        callers = [dial(listener, HELLO, THERE) for _ in range(BURST + 1)]
        taken = [listener.accept()[0] for _ in callers]
        until(lambda: said, what="a report")
        assert f"from {THERE} come faster than they become links" in said[0]
        for _ in callers:
            one.linked("id", "ground", f"{THERE}:1")
        dial(listener, HELLO, HERE).close()
        for connection in (*callers, *taken):
            connection.close()


def test_closed_door_leaves_the_port_as_it_was() -> None:
    with socket.create_server((HERE, 0)) as listener:
        Door([listener.getsockname()[1]], pytest.fail).close()
        listener.settimeout(PATIENCE_S)
        with dial(listener, b"anything") as any_one:
            accepted, peer = listener.accept()
            accepted.close()
            assert peer == any_one.getsockname()


def refuse(patch: pytest.MonkeyPatch, *options: int) -> None:
    """Let the system refuse some programs."""

    def attach_or_refuse(listener: socket.socket, steps: list[Step], option: int) -> None:
        if option in options:
            raise PermissionError(option)
        attach(listener, steps, option)

    patch.setattr(door, "attach", attach_or_refuse)


@pytest.mark.usefixtures("stopped_clock")
def test_silence_stays_out_and_shares_are_kept_without_the_privilege(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refuse(monkeypatch, SO_ATTACH_FILTER)
    with guarded() as (listener, _, said), dial(listener, b""):
        assert said == [UNPRIVILEGED]
        callers = [dial(listener, b"GET /", THERE) for _ in range(BURST + 1)]
        taken = [listener.accept() for _ in callers]
        assert {peer[0] for _, peer in taken} == {THERE}
        until(lambda: len(said) == 2, what="a report")
        assert f"from {THERE} come faster than they become links" in said[1]
        for connection in (*callers, *(one for one, _ in taken)):
            connection.close()


def test_system_without_filters_is_named_and_lets_all_in(monkeypatch: pytest.MonkeyPatch) -> None:
    refuse(monkeypatch, SO_ATTACH_FILTER, SO_ATTACH_REUSEPORT_CBPF)
    with guarded() as (listener, _, said):
        assert said == [UNAVAILABLE]
        with dial(listener, b"") as silent:
            accepted, peer = listener.accept()
            accepted.close()
            assert peer == silent.getsockname()


def test_links_cost_an_address_nothing() -> None:
    limits = Limits()
    for _ in range(100):
        limits.arrived(ADA, 0.0)
        limits.linked(ADA)
    assert limits.shares(0.0) == {}


def test_share_falls_with_failures_and_others_keep_theirs() -> None:
    limits = Limits()
    for _ in range(BURST + 3):
        limits.arrived(EVE, 0.0)
    limits.arrived(ADA, 0.0)
    assert limits.shares(0.0) == {EVE: 0.125}


def test_no_address_is_shut_out() -> None:
    limits = Limits()
    for _ in range(10_000):
        limits.arrived(EVE, 0.0)
    assert limits.shares(0.0) == {EVE: LEAST_SHARE}
    for second in range(1, 13):
        limits.shares(float(second))
    assert limits.shares(13.0) == {}


def test_links_restore_a_share_at_once() -> None:
    """Forty robots behind one address dial at the same time after a restart of the router."""
    limits = Limits()
    for _ in range(40):
        limits.arrived(ADA, 0.0)
    assert limits.shares(0.0)[ADA] < 0.01
    for _ in range(40):
        limits.linked(ADA)
    assert limits.shares(0.0) == {}


def test_known_addresses_are_bounded() -> None:
    limits = Limits()
    for number in range(5000):
        for _ in range(BURST + 1):
            limits.arrived(ip_address(0x0A000000 + number), 0.0)
    assert len(limits.shares(0.0)) == door.MAX_LIMITED
    assert len(choice_steps(limits.shares(0.0))) < 4096, "the kernel's limit"
