"""The thread that receives stop datagrams, over real sockets, and the client that sends them."""

import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event

import pytest

from checks.harness.processes import free_port
from checks.harness.until import PATIENCE_S, until
from ground.client.stop_datagrams import StopDatagrams
from protocol.bus.network import Network, Tls
from protocol.stop_datagram import (
    OPEN_SECRET,
    PRESS,
    PRESS_BYTES,
    Press,
    sealed_press,
    stopped_by,
)
from robot.stop_listener import OLD_S, StopListener

LOCAL = "127.0.0.1"


class Stopping:
    """A robot that stops with its next tick."""

    def __init__(self) -> None:
        self.pressed: list[tuple[str, int]] = []
        self.notes: list[str] = []
        self.ticked = 0
        self.stopped = False

    def press(self, operator: str, request_id: int) -> int:
        self.pressed.append((operator, request_id))
        return len(self.pressed)

    def has_stopped(self, press: int) -> bool:
        return self.stopped and press <= self.ticked

    def note(self, words: str) -> None:
        self.notes.append(words)

    def tick(self) -> None:
        self.ticked, self.stopped = len(self.pressed), True


class Stage:
    """A listener, its robot, and what it has logged."""

    def __init__(self, network: Network | None = None) -> None:
        self.port = free_port(socket.SOCK_DGRAM)
        self.robot, self.lines = Stopping(), list[str]()
        self.network = (
            Network(connect=(f"tcp/{LOCAL}:{self.port}",)) if network is None else network
        )
        self.listener = StopListener(
            self.network, "r1", (f"tcp/{LOCAL}:{self.port}",), self.robot, self.lines.append
        )


@contextmanager
def listening(network: Network | None = None) -> Iterator[Stage]:
    stage = Stage(network)
    with stage.listener:
        yield stage


def write_secrets(folder: Path, role: str, *names: str, secret: bytes) -> Tls:
    lines = "".join(f'{name} = "{secret.hex()}"\n' for name in names)
    (folder / f"{role}.stops").write_text(f"[secrets]\n{lines}")
    place = str(folder / role)
    return Tls(ca=str(folder / "ca.pem"), certificate=f"{place}.pem", key=f"{place}.key")


def test_a_press_stops_and_its_repetition_is_answered() -> None:
    with listening() as stage, StopDatagrams(stage.network, "r1", None) as sender:
        assert not sender.why
        sender.press(17)
        until(lambda: stage.robot.pressed)
        assert stage.robot.pressed[0] == ("open", 17)
        assert not sender.has_stopped(17)
        stage.robot.tick()

        def answered() -> bool:
            sender.press(17)
            return sender.has_stopped(17)

        until(answered, poll_s=0.02)
        assert not sender.has_stopped(18)
    assert stage.lines == []


def test_locked_robot_takes_the_stop_of_its_operators_only(tmp_path: Path) -> None:
    secret = secrets.token_bytes(32)
    ours = write_secrets(tmp_path, "robot-r1", "ada", "bob", secret=secret)
    adas = write_secrets(tmp_path, "ground-ada", "r1", secret=secret)
    bobs = write_secrets(tmp_path, "ground-bob", "r1", secret=secret)
    eves = write_secrets(tmp_path, "ground-eve", "r1", secret=secrets.token_bytes(32))
    with listening(Network(tls=ours, revoked=("ground-bob",))) as stage:
        dialled = (f"tls/{LOCAL}:{stage.port}",)
        for locked, holder in ((eves, "ground-eve"), (eves, "ground-ada"), (bobs, "ground-bob")):
            with StopDatagrams(Network(tls=locked, connect=dialled), "r1", holder) as stranger:
                stranger.press(1)
        with StopDatagrams(Network(tls=adas, connect=dialled), "r1", "ground-ada") as ada:
            ada.press(2)
        until(lambda: stage.robot.pressed)
        assert stage.robot.pressed == [("ada", 2)]


def test_the_copy_of_an_old_stop_is_ignored_and_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr("robot.stop_listener.time.monotonic", lambda: now_s)
    stage = Stage()
    packet = sealed_press(OPEN_SECRET, "r1", Press("open", 5, 17))
    for later_s, reports in ((0.0, 0), (OLD_S / 2, 0), (OLD_S, 1)):
        now_s = 100.0 + later_s
        for _ in range(2):
            answer = stage.listener.take(packet, LOCAL)
            assert answer is not None
            assert stopped_by(answer, OPEN_SECRET, "r1", "open") is None
        assert len(stage.robot.notes) == reports, "the network doubles at once"
    assert stage.robot.pressed == [("open", 17)]
    assert "old stop datagram of open came again once" in stage.robot.notes[0]
    assert LOCAL in stage.robot.notes[0]
    stage.listener.close()


def test_a_packet_that_fails_does_not_end_the_way() -> None:
    with listening() as stage, StopDatagrams(stage.network, "r1", None) as sender:
        healthy = stage.robot.press

        def broken(operator: str, request_id: int) -> int:
            raise ZeroDivisionError("a defect")

        stage.robot.press = broken  # type: ignore[method-assign]
        sender.press(1)
        until(lambda: stage.robot.notes)
        assert stage.robot.notes == ["a stop datagram failed: a defect"]
        stage.robot.press = healthy  # type: ignore[method-assign]
        sender.press(2)
        until(lambda: stage.robot.pressed)
    assert stage.robot.pressed == [("open", 2)]


def test_while_the_stop_holds_a_copy_is_answered_without_a_report() -> None:
    stage = Stage()
    packet = sealed_press(OPEN_SECRET, "r1", Press("open", 5, 17))
    assert stage.listener.take(packet, LOCAL) is not None
    stage.robot.tick()
    answer = stage.listener.take(packet, LOCAL)
    assert answer is not None
    assert stopped_by(answer, OPEN_SECRET, "r1", "open") == 17
    assert stage.robot.notes == []
    stage.listener.close()


def test_reports_of_copies_are_rare_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr("robot.stop_listener.time.monotonic", lambda: now_s)
    stage = Stage()
    packet = sealed_press(OPEN_SECRET, "r1", Press("open", 5, 17))
    stage.listener.take(packet, LOCAL)
    now_s += OLD_S
    for _ in range(1000):
        stage.listener.take(packet, LOCAL)
    assert len(stage.robot.notes) == 1
    now_s += 10.0
    stage.listener.take(packet, LOCAL)
    assert "1000 times" in stage.robot.notes[1]
    stage.listener.close()


def test_noise_is_not_answered() -> None:
    stage = Stage()
    assert stage.listener.take(b"GET / HTTP/1.1\r\n\r\n", LOCAL) is None
    assert stage.robot.pressed == []
    stage.listener.close()


def test_a_press_is_received_behind_a_flood_of_noise() -> None:
    with (
        listening() as stage,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker,
        StopDatagrams(stage.network, "r1", None) as sender,
    ):

        def pressed() -> bool:
            for _ in range(1000):
                attacker.sendto(b"x" * 85, (LOCAL, stage.port))
            sender.press(3)
            return bool(stage.robot.pressed)

        until(pressed)


def test_other_datagrams_take_no_room_from_a_press() -> None:
    """A flood is faster than the thread reads: what it sends must not fill the receive buffer."""
    with listening() as stage, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        if stage.lines:
            pytest.skip(stage.lines[0])  # this system permits no filter
        held, entered = Event(), Event()
        noted = stage.robot.press

        def press(operator: str, request_id: int) -> int:
            entered.set()
            held.wait()
            return noted(operator, request_id)

        stage.robot.press = press  # type: ignore[method-assign]
        try:
            place = LOCAL, stage.port
            sender.sendto(sealed_press(OPEN_SECRET, "r1", Press("open", 1, 1)), place)
            assert entered.wait(PATIENCE_S)
            for noise in (b"x" * PRESS_BYTES, PRESS, PRESS.ljust(PRESS_BYTES + 1), b""):
                for _ in range(5000):
                    sender.sendto(noise, place)
            sender.sendto(sealed_press(OPEN_SECRET, "r1", Press("open", 2, 2)), place)
        finally:
            held.set()
        until(lambda: ("open", 2) in stage.robot.pressed)


def test_a_system_without_filters_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for stand_in in (refused, None):
        if stand_in is None:
            monkeypatch.setattr("robot.stop_listener.sys.platform", "other")
        else:
            monkeypatch.setattr("robot.stop_listener.attach", stand_in)
        with listening() as stage, StopDatagrams(stage.network, "r1", None) as sender:
            (line,) = stage.lines
            assert "without a filter" in line
            sender.press(17)
            until(lambda: stage.robot.pressed)


def refused(*_: object) -> None:
    raise PermissionError(1, "Operation not permitted")


def test_all_addresses_of_a_name_are_received_at(monkeypatch: pytest.MonkeyPatch) -> None:
    port, lines, robot = free_port(socket.SOCK_DGRAM), list[str](), Stopping()
    lacking = "192.0.2.1"  # no interface has it
    sent: list[tuple[str, int]] = []

    def look_up(host: str, port: int, **_: object) -> list[tuple[object, ...]]:
        datagrams = socket.AF_INET, socket.SOCK_DGRAM, 17, ""
        return [(*datagrams, (one, port)) for one in (LOCAL, "127.0.0.2", lacking)]

    monkeypatch.setattr("robot.stop_listener.socket.getaddrinfo", look_up)
    endpoints = (f"tcp/robot.example:{port}",)
    with StopListener(Network(), "r1", endpoints, robot, lines.append) as listener:
        assert listener.places == [("robot.example", port)]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for number, where in enumerate((LOCAL, "127.0.0.2"), 1):
                packet = sealed_press(OPEN_SECRET, "r1", Press("open", number, number))
                sender.sendto(packet, (where, port))
                sent.append(("open", number))
                until(lambda: robot.pressed == sent)
    assert lines == [], "a kind of address that this system lacks is no fault"


def test_what_keeps_it_from_receiving_is_told(tmp_path: Path) -> None:
    with listening() as stage:
        lines: list[str] = []
        endpoints = (f"tcp/{LOCAL}:{stage.port}",)
        with StopListener(Network(), "r1", endpoints, stage.robot, lines.append) as second:
            assert second.places == []
        assert "in use" in lines[0]
    lines.clear()
    StopListener(Network(), "r1", (), stage.robot, lines.append).close()
    assert "--stop-at" in lines[0]
    missing = str(tmp_path / "robot-r1")
    tls = Tls(ca="ca.pem", certificate=f"{missing}.pem", key=f"{missing}.key")
    StopListener(Network(tls=tls), "r1", endpoints, stage.robot, lines.append).close()
    assert "keys stops DIR" in lines[1]


def test_a_name_is_looked_up_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The name server may be down at the start, and a robot may get another address."""
    asked: list[str] = []

    def look_up(host: str, port: int, **_: object) -> list[tuple[object, ...]]:
        asked.append(host)
        if len(asked) == 1:
            raise socket.gaierror("no name server")
        where = "127.0.0.2" if len(asked) < 4 else LOCAL
        return [(socket.AF_INET, socket.SOCK_DGRAM, 0, "", (where, port))]

    monkeypatch.setattr("ground.client.stop_datagrams.socket.getaddrinfo", look_up)
    monkeypatch.setattr("ground.client.stop_datagrams.REFRESH_S", 0.01)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        robot.bind((LOCAL, 0))
        robot.settimeout(0.02)
        dialled = Network(connect=(f"tcp/robot.example:{robot.getsockname()[1]}",))
        with StopDatagrams(dialled, "r1", None) as sender:

            def received() -> bool:
                sender.press(3)
                with suppress(TimeoutError):
                    return bool(robot.recv(200))
                return False

            until(received)
            assert sender.why == ""
    assert len(asked) >= 4


def test_what_keeps_a_client_from_sending_is_told(tmp_path: Path) -> None:
    missing = str(tmp_path / "ground-ada")
    tls = Tls(ca="ca.pem", certificate=f"{missing}.pem", key=f"{missing}.key")
    dialled = Network(tls=tls, connect=(f"tls/{LOCAL}:1",))
    assert "keys stops DIR" in StopDatagrams(dialled, "r1", "ground-ada").why
    assert "not that of an operator" in StopDatagrams(dialled, "r1", "viewer").why
    named = write_secrets(tmp_path, "ground-ada", "r2", secret=bytes(32))
    other = StopDatagrams(Network(tls=named, connect=dialled.connect), "r1", "ground-ada")
    assert "no secret for r1" in other.why
    assert "stop_at" in StopDatagrams(Network(connect=("unixsock-stream/a",)), "r1", None).why
    other.press(1)  # nothing happens
    assert not other.has_stopped(1)
