"""Real sockets and a pseudo-terminal, without waiting."""

import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest

from gateways.mavlink.endpoints import (
    MAX_BYTES,
    MAX_CONNECTIONS,
    MAX_PEERS,
    VANISHED_MS,
    Endpoint,
    ReceivedBytes,
    SendBuffer,
    SerialEndpoint,
    all_opened,
    opened,
)
from runtime.errors import UserError
from runtime.units import NS_PER_S
from tests.support.each import each
from tests.support.until import until


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def received(endpoint: Endpoint, count: int = 1) -> list[ReceivedBytes]:
    found: list[ReceivedBytes] = []

    def is_all() -> bool:
        found.extend(endpoint.receive())
        return len(found) >= count

    until(is_all)
    return found


def test_udpin_serves_several_clients_at_once(stack: ExitStack) -> None:
    endpoint: Any = stack.enter_context(closing(opened("udpin:127.0.0.1:0")))
    sockets = []
    for _ in range(MAX_PEERS + 1):
        one = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        one.sendto(b"hello", ("127.0.0.1", endpoint.port))
        sockets.append(one)
    peers = [one.peer for one in received(endpoint, MAX_PEERS + 1)]
    assert len(set(peers)) == MAX_PEERS + 1
    endpoint.send(peers[3], b"answer", is_stream=False)
    assert sockets[3].recv(100) == b"answer"
    endpoint.forget(peers[0])
    sockets[-1].sendto(b"again", ("127.0.0.1", endpoint.port))
    assert received(endpoint)[0].data == b"again"


def test_udpout_sends_first_and_hears_only_its_peer(stack: ExitStack) -> None:
    client = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    client.bind(("127.0.0.1", 0))
    place = f"127.0.0.1:{client.getsockname()[1]}"
    endpoint = stack.enter_context(closing(opened(f"udpout:{place}")))
    assert list(endpoint.lasting()) == [place]
    endpoint.send(place, b"first", is_stream=True)
    _, address = client.recvfrom(100)
    other = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    other.sendto(b"forged", address)
    client.sendto(b"mine", address)
    assert [one.data for one in received(endpoint)] == [b"mine"]


def test_tcpin_serves_clients_and_notes_the_end(stack: ExitStack) -> None:
    endpoint: Any = stack.enter_context(closing(opened("tcpin:127.0.0.1:0")))
    first, second = (
        stack.enter_context(socket.create_connection(("127.0.0.1", endpoint.port)))
        for _ in range(2)
    )
    first.sendall(b"one")
    second.sendall(b"two")
    assert sorted(one.data for one in received(endpoint, 2)) == [b"one", b"two"]
    peers = list(endpoint.lasting())
    assert len(endpoint.filenos()) == 3
    endpoint.send(peers[1], b"answer", is_stream=False)
    assert second.recv(100) == b"answer"
    first.close()
    until(lambda: not endpoint.receive() and len(endpoint.lasting()) == 1)
    assert endpoint.gone() == peers[:1]


def test_connections_beyond_the_limit_are_closed(stack: ExitStack) -> None:
    endpoint: Any = stack.enter_context(closing(opened("tcpin:127.0.0.1:0")))
    for number in range(MAX_CONNECTIONS):
        stack.enter_context(socket.create_connection(("127.0.0.1", endpoint.port)))
        until(lambda: not endpoint.receive() and len(endpoint.lasting()) == number + 1)  # noqa: B023
    extra = stack.enter_context(socket.create_connection(("127.0.0.1", endpoint.port)))
    until(lambda: not endpoint.receive() and endpoint.refused)
    assert extra.recv(1) == b""
    assert len(endpoint.lasting()) == MAX_CONNECTIONS


def test_vanished_tcp_client_ends_after_ten_seconds(stack: ExitStack) -> None:
    endpoint: Any = stack.enter_context(closing(opened("tcpin:127.0.0.1:0")))
    stack.enter_context(socket.create_connection(("127.0.0.1", endpoint.port)))
    until(lambda: not endpoint.receive() and bool(endpoint.lasting()))
    (connection,) = endpoint._connections.values()
    timeout_ms = connection.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)
    assert timeout_ms == VANISHED_MS == 10_000


def test_slow_tcp_reader_never_blocks_and_never_grows(stack: ExitStack) -> None:
    endpoint: Any = stack.enter_context(closing(opened("tcpin:127.0.0.1:0")))
    client = stack.enter_context(socket.create_connection(("127.0.0.1", endpoint.port)))
    until(lambda: not endpoint.receive() and bool(endpoint.lasting()))
    (peer,) = endpoint.lasting()
    for _ in range(10_000):
        endpoint.send(peer, bytes(1_000), is_stream=False)
        endpoint.flush(0)
    buffer = endpoint._connections[peer].buffer
    assert buffer.dropped > 0
    assert len(buffer) <= MAX_BYTES
    assert client.recv(10)


def test_telemetry_is_dropped_before_answers() -> None:
    taken: list[bytes] = []
    room = [150]

    def write(data: bytes) -> int:
        now = min(len(data), room[0])
        if not now:
            raise BlockingIOError
        room[0] -= now
        taken.append(data[:now])
        return now

    buffer = SendBuffer(write, stream_bytes=100)
    for _ in range(5):
        buffer.add(b"s" * 60, is_stream=True)
    assert buffer.dropped == 1
    buffer.add(b"a" * 60, is_stream=False)
    assert buffer.dropped == 1
    room[0] = 10_000
    buffer.flush()
    assert b"".join(taken) == b"s" * 240 + b"a" * 60


def test_serial_line_carries_bytes_both_ways(stack: ExitStack) -> None:
    master, slave = os.openpty()
    device = os.ttyname(slave)
    os.close(slave)
    endpoint = stack.enter_context(closing(opened(f"serial:{device}:57600")))
    assert endpoint.line_bytes_s == 4_800
    os.write(master, b"\x00\xfd\n\r\x11")
    assert b"".join(one.data for one in received(endpoint)) == b"\x00\xfd\n\r\x11"
    endpoint.send(device, b"\n\xfe\x03", is_stream=False)
    assert os.read(master, 100) == b"\n\xfe\x03"
    for _ in range(1_000):
        endpoint.send(device, bytes(200), is_stream=True)
    assert isinstance(endpoint, SerialEndpoint)
    assert endpoint._buffer.dropped > 0
    assert len(endpoint._buffer) <= 480 + 200
    os.close(master)
    until(lambda: not endpoint.receive() and not endpoint.filenos())
    assert endpoint.gone() == [device]
    endpoint.send(device, b"lost", is_stream=False)
    endpoint.flush(10**10)


def test_lost_serial_line_is_opened_again_when_it_is_back(stack: ExitStack, tmp_path: Path) -> None:
    device = tmp_path / "radio"

    def plugged_in() -> int:
        master, slave = os.openpty()
        device.symlink_to(os.ttyname(slave))
        os.close(slave)
        return master

    master = plugged_in()
    endpoint = stack.enter_context(closing(opened(f"serial:{device}:57600")))
    os.close(master)
    device.unlink()
    until(lambda: not endpoint.receive() and not endpoint.filenos())
    assert endpoint.gone() == [str(device)]
    endpoint.flush(NS_PER_S)
    assert not endpoint.lasting()
    master = plugged_in()
    endpoint.flush(2 * NS_PER_S)
    assert list(endpoint.lasting()) == [str(device)]
    os.write(master, b"back")
    assert received(endpoint)[0].data == b"back"
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
