"""A fresh `estop` with real processes, locked doors and no session of Zenoh to be had."""

import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from ground.certificates.folder import make
from ground.launch.child_command import command
from tests.stack.hostile_input.test_locks import Locked
from tests.support.keyring import DAY, NOW
from tests.support.stack.processes import free_endpoint
from tests.support.until import until

pytestmark = pytest.mark.stack
BY_DATAGRAM = "by datagram"


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ways") / "keys"
    make(folder, ["r1", "r2"], {}, NOW - DAY, NOW + DAY, ["ada", "bob"])
    return folder


@pytest.fixture
def crew(keys: Path) -> Iterator[Locked]:
    with Locked(keys, lockstep=True) as crew:
        crew.robot()
        crew.plant()
        yield crew


def cut_off(crew: Locked, keys: Path, role: str, folder: Path) -> list[str]:
    """Return the words for an operator whose bus is not there, but the robot's address is."""
    address = crew.endpoint.partition("/")[2]
    text = (keys / f"{role}.toml").read_text().replace(f'"{role}.', f'"{keys}/{role}.')
    text = text.replace('"ca.pem"', f'"{keys}/ca.pem"')
    file = folder / "away.toml"
    file.write_text(f'{text}\n[network.stop_at]\nr1 = "{address}"\n')
    nobody = free_endpoint().replace("tcp/", "tls/")
    return ["--id", "r1", "--config", str(file), "--connect", nobody]


def test_without_any_session_an_operator_stops_and_others_do_not(
    crew: Locked, keys: Path, tmp_path: Path
) -> None:
    for role in ("viewer", "plant", "recorder"):
        stranger = crew.execute(
            *command(("estop", *cut_off(crew, keys, role, tmp_path)), os.getpid())
        )
        assert stranger.ends() != 0
        assert "not that of an operator" in stranger.said
    ended = crew.execute(
        *command(("estop", *cut_off(crew, keys, "ground-ada", tmp_path)), os.getpid())
    )
    assert ended.ends() == 0, ended.said
    assert BY_DATAGRAM in ended.said
    code, said = crew.verb("ground-bob", "arm")
    assert code == 1
    assert "emergency stop" in said


@contextmanager
def garbage(endpoint: str, *, pause_s: float = 0.02) -> Iterator[None]:
    """Open a connection that is no TLS again and again, and never one with a certificate."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    ended = threading.Event()

    def attack() -> None:
        while not ended.wait(pause_s):
            with suppress(OSError), socket.create_connection((host, int(port)), 1.0) as opened:
                opened.sendall(b"no TLS, and no key")

    threads = [threading.Thread(target=attack) for _ in range(2)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        for thread in threads:
            thread.join()


def test_garbage_connections_do_not_keep_an_operator_out(crew: Locked, keys: Path) -> None:
    with garbage(crew.endpoint):
        for _ in range(3):
            code, said = crew.verb("ground-ada", "estop")
            assert code == 0, said
            assert "E-STOP acknowledged by r1" in said


def test_a_robot_with_older_keys_says_how_to_add_secrets(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    make(folder, ["r1"], {}, NOW - DAY, NOW + DAY)
    for path in folder.glob("*.stops"):
        path.unlink()
    with Locked(folder, lockstep=True) as crew:
        robot = crew.robot()
        crew.plant()
        until(lambda: "stop datagrams are not received" in robot.said)
        assert "`sidestep keys stops DIR`" in robot.said
        code, said = crew.verb("ground", "estop")
        assert code == 0, said
