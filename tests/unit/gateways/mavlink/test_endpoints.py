"""Real sockets and a pseudo-terminal on a played loop, without waiting."""

import os
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from checks.harness.loop import PlayedLoop
from checks.harness.until import until
from gateways.mavlink.endpoints import (
    MAX_BYTES,
    MAX_CONNECTIONS,
    MAX_DATAGRAMS,
    MAX_PEERS,
    REOPEN_S,
    STREAM_BYTES,
    VANISHED_MS,
    Arrival,
    Endpoint,
    SerialEndpoint,
    all_opened,
    has_room,
    opened,
)
from runtime.clock import ManualClock
from runtime.errors import UserError
from runtime.units import NS_PER_S
from tests.support.each import each


class Arrivals:
    """Notes what arrives at an endpoint, on a loop of its own."""

    def __init__(self, text: str) -> None:
        self.loop = PlayedLoop(ManualClock())
        self.endpoint: Any = opened(text)
        self.data: list[tuple[str, bytes]] = []
        self.together: list[int] = []
        self.are_loopback: list[bool] = []
        self.peers: list[str] = []
        self.ended: list[str] = []
        self.loop.run(self.endpoint.attach(self))

    def connected(self, endpoint: Endpoint, peer: str) -> None:
        self.peers.append(peer)

    def disconnected(self, endpoint: Endpoint, peer: str) -> None:
        self.peers.remove(peer)
        self.ended.append(peer)

    def received(self, endpoint: Endpoint, arrived: Sequence[Arrival]) -> None:
        self.together.append(len(arrived))
        self.are_loopback += [one.is_loopback for one in arrived]
        self.data += [(one.peer, one.data) for one in arrived]

    def until(self, is_met: Callable[[], object]) -> None:
        """Let the endpoint work until a condition is met."""

        def is_met_now() -> object:
            self.loop.advance()
            return is_met()

        until(is_met_now)

    def take(self, count: int = 1) -> list[tuple[str, bytes]]:
        """Return what has arrived once it is so much."""
        self.until(lambda: len(self.data) >= count)
        found, self.data = self.data, []
        return found

    def close(self) -> None:
        self.endpoint.close()
        self.loop.advance()
        self.loop.close()


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def test_udpin_serves_several_clients_at_once(stack: ExitStack) -> None:
    at = stack.enter_context(closing(Arrivals("udpin:127.0.0.1:0")))
    sockets = []
    for _ in range(MAX_PEERS + 1):
        one = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        one.sendto(b"hello", ("127.0.0.1", at.endpoint.port))
        sockets.append(one)
    peers = [peer for peer, _ in at.take(MAX_PEERS + 1)]
    assert len(set(peers)) == MAX_PEERS + 1
    at.endpoint.send(peers[3], b"answer", is_stream=False)
    assert sockets[3].recv(100) == b"answer"
    at.endpoint.forget(peers[0])
    sockets[-1].sendto(b"again", ("127.0.0.1", at.endpoint.port))
    assert at.take()[0][1] == b"again"


@each("text", ["udpin:[::1]:0", "udpin://127.0.0.1:0", "udpin://[::]:0", "tcpin:[::]:0"])
def test_endpoint_takes_ipv6_addresses_and_urls(text: str) -> None:
    is_udp = text.startswith("udp")
    kind = socket.SOCK_DGRAM if is_udp else socket.SOCK_STREAM
    hosts = [host for host in ("127.0.0.1", "::1") if "::]" in text or (host in text)]
    for host in hosts:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        with closing(Arrivals(text)) as at, socket.socket(family, kind) as client:
            client.connect((host, at.endpoint.port))
            client.sendall(b"hello")
            ((peer, data),) = at.take()
            assert (data, at.are_loopback) == (b"hello", [True])
            at.endpoint.send(peer, b"answer", is_stream=False)
            assert client.recv(100) == b"answer"


def test_udpout_reaches_an_ipv6_address(stack: ExitStack) -> None:
    client = stack.enter_context(socket.socket(socket.AF_INET6, socket.SOCK_DGRAM))
    client.bind(("::1", 0))
    place = f"[::1]:{client.getsockname()[1]}"
    at = stack.enter_context(closing(Arrivals(f"udpout://{place}")))
    at.endpoint.send(place, b"first", is_stream=True)
    _, address = client.recvfrom(100)
    client.sendto(b"mine", address)
    assert at.take() == [(place, b"mine")]


def test_udp_keeps_no_datagram_that_the_socket_does_not_take(
    stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = stack.enter_context(closing(Arrivals("udpin:127.0.0.1:0")))
    room = [b"one frame"]

    def sendto(data: bytes, _: object) -> None:
        if not room:
            raise BlockingIOError
        room.pop()
        sent.append(data)

    sent: list[bytes] = []
    with monkeypatch.context() as patch:
        patch.setattr(at.endpoint, "_socket", SimpleNamespace(sendto=sendto))
        for number in range(3):
            at.endpoint.send("127.0.0.1:9", bytes((number,)), is_stream=False)
        room.append(b"one frame")
        at.endpoint.send("127.0.0.1:9", b"newest", is_stream=False)
    assert sent == [b"\0", b"newest"]


def test_udp_passes_on_together_what_has_arrived_together(stack: ExitStack) -> None:
    at = stack.enter_context(closing(Arrivals("udpin:127.0.0.1:0")))
    sender = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    for number in range(MAX_DATAGRAMS + 1):
        sender.sendto(bytes((number,)), ("127.0.0.1", at.endpoint.port))
    assert [data for _, data in at.take(MAX_DATAGRAMS + 1)] == [
        bytes((number,)) for number in range(MAX_DATAGRAMS + 1)
    ]
    assert at.together == [MAX_DATAGRAMS, 1]


def test_udpout_sends_first_and_hears_only_its_peer(stack: ExitStack) -> None:
    client = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    client.bind(("127.0.0.1", 0))
    place = f"127.0.0.1:{client.getsockname()[1]}"
    at = stack.enter_context(closing(Arrivals(f"udpout:{place}")))
    assert at.peers == [place]
    at.endpoint.send(place, b"first", is_stream=True)
    _, address = client.recvfrom(100)
    other = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    other.sendto(b"forged", address)
    client.sendto(b"mine", address)
    assert [data for _, data in at.take()] == [b"mine"]


def test_tcpin_serves_clients_and_notes_the_end(stack: ExitStack) -> None:
    at = stack.enter_context(closing(Arrivals("tcpin:127.0.0.1:0")))
    first, second = (
        stack.enter_context(socket.create_connection(("127.0.0.1", at.endpoint.port)))
        for _ in range(2)
    )
    first.sendall(b"one")
    second.sendall(b"two")
    assert sorted(data for _, data in at.take(2)) == [b"one", b"two"]
    peers = list(at.peers)
    at.endpoint.send(peers[1], b"answer", is_stream=False)
    assert second.recv(100) == b"answer"
    first.close()
    at.until(lambda: len(at.peers) == 1)
    assert at.ended == peers[:1]


def test_end_of_what_a_tcp_client_sends_ends_it(stack: ExitStack) -> None:
    at = stack.enter_context(closing(Arrivals("tcpin:127.0.0.1:0")))
    client = stack.enter_context(socket.create_connection(("127.0.0.1", at.endpoint.port)))
    at.until(lambda: at.peers)
    (peer,) = at.peers
    for _ in range(10_000):
        at.endpoint.send(peer, bytes(1_000), is_stream=False)
    client.shutdown(socket.SHUT_WR)
    at.until(lambda: not at.peers)  # it is not waited for until it has read all


def test_connections_beyond_the_limit_are_closed(stack: ExitStack) -> None:
    at = stack.enter_context(closing(Arrivals("tcpin:127.0.0.1:0")))
    for number in range(MAX_CONNECTIONS):
        stack.enter_context(socket.create_connection(("127.0.0.1", at.endpoint.port)))
        at.until(lambda: len(at.peers) == number + 1)  # noqa: B023
    extra = stack.enter_context(socket.create_connection(("127.0.0.1", at.endpoint.port)))
    at.until(lambda: at.endpoint.refused)
    at.loop.advance()
    assert extra.recv(1) == b""
    assert len(at.peers) == MAX_CONNECTIONS


def test_vanished_tcp_client_ends_after_ten_seconds(stack: ExitStack) -> None:
    at = stack.enter_context(closing(Arrivals("tcpin:127.0.0.1:0")))
    stack.enter_context(socket.create_connection(("127.0.0.1", at.endpoint.port)))
    at.until(lambda: at.peers)
    (connection,) = at.endpoint._connections.values()
    connected = connection.transport.get_extra_info("socket")
    timeout_ms = connected.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)
    assert timeout_ms == VANISHED_MS == 10_000


def test_slow_tcp_reader_never_blocks_and_never_grows(stack: ExitStack) -> None:
    at = stack.enter_context(closing(Arrivals("tcpin:127.0.0.1:0")))
    client = stack.enter_context(socket.create_connection(("127.0.0.1", at.endpoint.port)))
    at.until(lambda: at.peers)
    (peer,) = at.peers
    for _ in range(10_000):
        at.endpoint.send(peer, bytes(1_000), is_stream=False)
    at.loop.advance()
    assert at.endpoint.dropped > 0
    assert at.endpoint._connections[peer].transport.get_write_buffer_size() <= MAX_BYTES
    assert client.recv(10)


def test_telemetry_is_dropped_before_answers() -> None:
    assert has_room(0, 10 * MAX_BYTES, STREAM_BYTES, is_stream=True)
    assert has_room(STREAM_BYTES - 60, 60, STREAM_BYTES, is_stream=True)
    assert not has_room(STREAM_BYTES - 59, 60, STREAM_BYTES, is_stream=True)
    assert has_room(STREAM_BYTES - 59, 60, STREAM_BYTES, is_stream=False)
    assert not has_room(MAX_BYTES - 59, 60, STREAM_BYTES, is_stream=False)


@each("kind", ["tcpin", "serial"])
def test_answers_wait_for_a_slow_line_that_drops_telemetry(stack: ExitStack, kind: str) -> None:
    far: socket.socket | None = None
    master, slave = os.openpty()
    stack.callback(os.close, master)
    device = os.ttyname(slave)
    os.close(slave)
    text = "tcpin:127.0.0.1:0" if kind == "tcpin" else f"serial:{device}:57600"
    at = stack.enter_context(closing(Arrivals(text)))
    if kind == "tcpin":
        far = stack.enter_context(socket.create_connection(("127.0.0.1", at.endpoint.port)))
        at.until(lambda: at.peers)
    (peer,) = at.peers
    while not at.endpoint.dropped:
        at.endpoint.send(peer, b"s" * 200, is_stream=True)
    at.endpoint.send(peer, b"a" * 60, is_stream=False)
    assert at.endpoint.dropped == 1
    found = bytearray()

    def is_all() -> bool:
        found.extend(far.recv(1 << 20) if far is not None else os.read(master, 1 << 16))
        return found.endswith(b"a" * 60)

    at.until(is_all)
    assert found.strip(b"s") == b"a" * 60


def test_serial_line_carries_bytes_both_ways(stack: ExitStack) -> None:
    master, slave = os.openpty()
    device = os.ttyname(slave)
    os.close(slave)
    at = stack.enter_context(closing(Arrivals(f"serial:{device}:57600")))
    endpoint = at.endpoint
    assert isinstance(endpoint, SerialEndpoint)
    assert endpoint.line_bytes_s == 4_800
    os.write(master, b"\x00\xfd\n\r\x11")
    assert b"".join(data for _, data in at.take()) == b"\x00\xfd\n\r\x11"
    endpoint.send(device, b"\n\xfe\x03", is_stream=False)
    assert os.read(master, 100) == b"\n\xfe\x03"
    for _ in range(1_000):
        endpoint.send(device, bytes(200), is_stream=True)
    assert endpoint.dropped > 0
    assert len(endpoint._waiting) <= 480 + 200
    os.close(master)
    at.until(lambda: not at.peers)
    assert at.ended == [device]
    endpoint.send(device, b"lost", is_stream=False)
    at.loop.advance(10**10)


def test_lost_serial_line_is_opened_again_when_it_is_back(stack: ExitStack, tmp_path: Path) -> None:
    device = tmp_path / "radio"

    def plugged_in() -> int:
        master, slave = os.openpty()
        device.symlink_to(os.ttyname(slave))
        os.close(slave)
        return master

    master = plugged_in()
    at = stack.enter_context(closing(Arrivals(f"serial:{device}:57600")))
    os.close(master)
    device.unlink()
    at.until(lambda: not at.peers)
    assert at.ended == [str(device)]
    at.loop.advance(round(REOPEN_S * NS_PER_S))
    assert not at.peers
    master = plugged_in()
    at.loop.advance(round(REOPEN_S * NS_PER_S))
    assert at.peers == [str(device)]
    os.write(master, b"back")
    assert at.take()[0][1] == b"back"
    os.close(master)


@each(
    ("text", "words"),
    [
        ("updin:127.0.0.1:14550", "did you mean udpin?"),
        ("bluetooth:x", "use one as in udpin:127.0.0.1:14550"),
        ("udpin", "use udpin:HOST:PORT"),
        ("tcpin:14550", "use tcpin:HOST:PORT, as in tcpin:127.0.0.1:14550"),
        ("udpin:127.0.0.1:99999", "ports end at 65535"),
        ("serial:/dev/ttyUSB0", "use serial:DEVICE:BAUD"),
        ("serial:/dev/none:57600", "no such device"),
        ("serial:/dev/none:fast", "use serial:DEVICE:BAUD, as in serial:/dev/ttyUSB0:57600"),
        ("serial:/dev/none:-1", "use serial:DEVICE:BAUD"),
        ("serial:/dev/null:57600", "not a serial line"),
        ("serial:/dev/null:57601", "57601 baud is not possible"),
        ("udpin:192.0.2.77:0", "does not have the address"),
        ("udpin:host.invalid:0", "unknown host"),
    ],
)
def test_bad_endpoint_is_refused_with_the_fix(text: str, words: str) -> None:
    with pytest.raises(UserError, match=words.replace("?", r"\?")) as caught:
        opened(text)
    assert text in str(caught.value)


def test_device_without_rights_is_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(UserError, match="dialout"):
        opened(f"serial:{tmp_path}/line:57600")


def test_port_in_use_is_refused_and_none_stays_open() -> None:
    with closing(opened("tcpin:127.0.0.1:0")) as first:
        taken = f"tcpin:127.0.0.1:{first.port}"  # type: ignore[attr-defined]
        with pytest.raises(UserError, match="another process uses this port"):
            all_opened(["udpin:127.0.0.1:0", taken])
