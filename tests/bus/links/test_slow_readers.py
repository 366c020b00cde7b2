"""A reader that is slow is dropped from, and neither the loop nor another asker waits for it."""

import os
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from threading import Event
from typing import Any

import pytest
import zenoh
from zenoh.handlers import Callback

from checks.harness.relays import SlowRelay
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.bus.services import ServiceRequest
from protocol.bus.session import configured
from protocol.bus.sockets import socket_of, sockets
from protocol.topics import PARAMETERS, TEXT, Role
from protocol.wire.messages import Statustext
from tests.support.bus.nets import net
from tests.support.keyring import Keyring
from tests.support.until import until

pytestmark = pytest.mark.stack

BYTES_PER_S = 20_000.0
LIST = bytes(200_000)
QUESTIONS = 40
WAITS_S = 4.0
"""Zenoh waits 5 s for a reader; a put that does not wait takes milliseconds on an idle machine."""


@contextmanager
def slow_viewer(robot: Bus, ring: Keyring) -> Iterator[zenoh.Session]:
    """Only listens, behind locked doors, and reads 20 kB/s."""
    with SlowRelay(robot.locator(), BYTES_PER_S) as relay:
        network = Network(mode="client", connect=(relay.endpoint,), tls=ring.tls("viewer"))
        with zenoh.open(configured(network, 2.0)) as session:
            yield session


@pytest.fixture
def locked(tmp_path: Path) -> Iterator[tuple[Bus, zenoh.Session, Bus]]:
    """Provide a listening robot, a slow viewer and the ground station."""
    ring = Keyring(tmp_path / "ring")
    listening = Network(listen=("tls/127.0.0.1:0",), tls=ring.tls("robot-r1"))
    with ExitStack() as stack:
        robot = stack.enter_context(open_bus(listening, Role.ROBOT, "r1"))
        viewer = stack.enter_context(slow_viewer(robot, ring))
        dialling = Network(mode="client", connect=(robot.locator(),), tls=ring.tls("ground"))
        yield robot, viewer, stack.enter_context(open_bus(dialling, Role.GROUND, "r1"))


def ignored() -> Any:
    return Callback(lambda _: None, indirect=False)


def ask(viewer: zenoh.Session, key: str) -> None:
    """Ask for what is long, in the way that makes Zenoh wait, at a priority of our choice."""
    for number in range(QUESTIONS):
        viewer.get(
            key,
            ignored(),
            timeout=10.0,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=(zenoh.Priority.DATA, zenoh.Priority.REAL_TIME)[number % 2],
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
        )


def worst_put_s(robot: Bus, times: int = 40) -> float:
    """Return the longest duration in seconds of `times` puts on a topic the viewer subscribes."""
    publisher, pause, worst_s = robot.publisher(TEXT), Event(), 0.0
    for _ in range(times):
        begun_s = time.monotonic()
        publisher.put(Statustext(severity=6, text="as ever"))
        worst_s = max(worst_s, time.monotonic() - begun_s)
        pause.wait(0.005)
    return worst_s


def test_slow_reader_of_long_answers_delays_no_publisher(
    locked: tuple[Bus, zenoh.Session, Bus],
) -> None:
    robot, viewer, ground = locked
    asked: list[ServiceRequest] = []

    def answer(question: ServiceRequest) -> None:
        asked.append(question)
        question.reply(LIST if len(asked) <= QUESTIONS else b"{}")

    robot.serve(PARAMETERS, answer)
    viewer.declare_subscriber(robot.key("**"), ignored())
    ask(viewer, robot.key(PARAMETERS.path))
    until(lambda: len(asked) >= QUESTIONS)
    assert worst_put_s(robot) < WAITS_S
    begun_s = time.monotonic()
    assert ground.ask(PARAMETERS, timeout_s=10.0) == b"{}"
    assert time.monotonic() - begun_s < WAITS_S


def test_slow_reader_of_histories_delays_no_publisher(
    locked: tuple[Bus, zenoh.Session, Bus],
) -> None:
    robot, viewer, _ = locked
    viewer.declare_subscriber(robot.key("**"), ignored())
    publisher = robot.publisher(TEXT)
    for _ in range(TEXT.history):
        publisher.put(Statustext(severity=6, text="x" * 50))
    for _ in range(5):
        ask(viewer, f"{robot.key(TEXT.path)}/@adv/pub/*/*/_?_max=512")
        assert worst_put_s(robot) < WAITS_S


def lingering(port: int) -> int:
    """Count the connections of this process on `port` that linger when they are closed."""
    found = 0
    for descriptor in sockets():
        with suppress(OSError), socket_of(os.dup(descriptor)) as one:
            if one.family == socket.AF_INET and port in (one.getsockname()[1], other_port(one)):
                found += one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)[0]
    return found


def other_port(end: socket.socket) -> int:
    try:
        return int(end.getpeername()[1])
    except OSError:
        return 0


def test_link_of_a_slow_reader_closes_without_lingering() -> None:
    """Lingering sockets once blocked the threads that receive samples for up to 10 s."""
    with net() as bus:
        port = int(bus.endpoint.rpartition(":")[2])
        assert len(links(port)) >= 4
        until(lambda: not lingering(port))
        bus.join(Role.GROUND)
        until(lambda: not lingering(port))


def links(port: int) -> list[str]:
    """Return the established connections to and from `port` that the system lists."""
    lines = Path("/proc/net/tcp").read_text().splitlines()
    return [line for line in lines if f":{port:04X} " in line and " 01 " in line]
