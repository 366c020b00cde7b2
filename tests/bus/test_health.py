"""A role is healthy only if its messages arrive; a live process alone is not enough."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from threading import Event, Thread

import pytest

from ground.cli.main import main
from ground.client import connection
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import HEARTBEAT, Role
from tests.support.networks import net
from tests.support.played_robot import played
from tests.support.stacks import Lively

pytestmark = pytest.mark.stack

Ask = Callable[..., tuple[int, str]]


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Dial an endpoint without a listener only once."""
    monkeypatch.setattr(connection, "CONNECT_TIMEOUT_S", 0.2)


@pytest.fixture
def ask(capsys: pytest.CaptureFixture[str]) -> Ask:
    """Run `sidestep run health`; return its exit code and standard error."""

    def run(*words: str) -> tuple[int, str]:
        code = main(["health", *words])
        return code, capsys.readouterr().err

    return run


def reach(stack: Lively, folder: Path) -> tuple[str, str]:
    """Return the options that connect to a stack with a prefix of its own."""
    file = folder / "health.toml"
    file.write_text(
        f'[network]\nmode = "client"\nconnect = ["{stack._hub}"]\nprefix = "{stack._prefix}"\n'
    )
    return "--config", str(file)


@contextmanager
def page(status: int) -> Iterator[str]:
    """Serve a page that answers every request with `status`."""

    class Answers(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(status)
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:
            """Silent."""

    with HTTPServer(("127.0.0.1", 0), Answers) as server:
        Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield f"127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.mark.parametrize("role", ["robot", "plant", "ground", "router"])
def test_all_roles_are_healthy_when_all_publish(role: str, tmp_path: Path, ask: Ask) -> None:
    with Lively(router=True) as stack, stack.going():
        assert ask(role, *reach(stack, tmp_path)) == (0, "")


def test_hung_robot_with_a_live_token_is_unhealthy(tmp_path: Path, ask: Ask) -> None:
    with Lively() as stack, stack.going():
        stack.hung = True
        code, why = ask("robot", *reach(stack, tmp_path))
    assert code == 1
    assert "no message on tlm/heartbeat of r1 within 1300 ms" in why
    assert "robot r1 is slow or hangs" in why


def test_silent_plant_is_unhealthy(tmp_path: Path, ask: Ask) -> None:
    with Lively() as stack, stack.going():
        stack.mute = True
        code, why = ask("plant", *reach(stack, tmp_path))
    assert code == 1
    assert "no message on sense/wheels of r1 within 450 ms: " in why
    assert "the plant is slow, hangs or is paused" in why


def test_plant_is_unhealthy_for_a_robot_it_does_not_carry(tmp_path: Path, ask: Ask) -> None:
    with Lively() as stack, stack.going():
        code, why = ask("plant", "--id", "r2", *reach(stack, tmp_path))
    assert (code, "no plant is running" in why) == (1, True), why


def test_health_names_another_robot_it_finds(ask: Ask) -> None:
    with played("r7") as (_, endpoint):
        code, why = ask("robot", "--connect", endpoint)
    assert (code, "only r7: name one that is there, as in --id r7" in why) == (1, True), why


def test_unreadable_frames_do_not_count_as_healthy(ask: Ask) -> None:
    network = Network(mode="peer", listen=("tcp/127.0.0.1:0",))
    with open_bus(network, Role.ROBOT, "r1") as bus:
        heart, over = bus.publisher(HEARTBEAT), Event()

        def babble() -> None:
            while not over.wait(0.01):
                heart.put_frame(b"noise")

        noisy = Thread(target=babble)
        noisy.start()
        code, why = ask("robot", "--connect", bus.locator())
        over.set()
        noisy.join()
    assert (code, "tlm/heartbeat of r1" in why, "no message on" in why) == (1, True, False), why


def test_a_robot_that_listens_is_no_router(ask: Ask) -> None:
    with played() as (_, endpoint):
        code, why = ask("router", "--connect", endpoint)
    assert (code, "is a peer, not a router" in why) == (1, True), why


def test_router_without_clients_is_healthy(ask: Ask) -> None:
    with net("router") as found:
        assert ask("router", "--connect", found.endpoint) == (0, "")


@pytest.mark.parametrize("role", ["robot", "plant", "ground", "router"])
def test_roles_are_unhealthy_without_a_listener(role: str, ask: Ask) -> None:
    code, why = ask(role, "--connect", "tcp/127.0.0.1:1")
    assert (code, "no process answers at tcp/127.0.0.1:1" in why) == (1, True), why


def test_page_that_requires_a_login_is_healthy(ask: Ask) -> None:
    with played() as (_, endpoint), page(403) as web:
        assert ask("ground", "--connect", endpoint, "--web", web) == (0, "")


def test_a_ground_station_without_a_page_or_with_a_broken_one_is_not(ask: Ask) -> None:
    with played() as (_, endpoint), page(500) as web:
        code, why = ask("ground", "--connect", endpoint, "--web", web)
        assert (code, "fails with status 500" in why) == (1, True), why
        code, why = ask("ground", "--connect", endpoint, "--web", "127.0.0.1:1")
        assert (code, "no page at http://127.0.0.1:1/" in why) == (1, True), why


def test_a_script_gets_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    with played() as (_, endpoint):
        assert main(["health", "robot", "--json", "--connect", endpoint]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found == {"role": "robot", "robot": "r1", "ok": True}
    assert main(["health", "robot", "--json", "--connect", "tcp/127.0.0.1:1"]) == 1
    assert json.loads(capsys.readouterr().out)["ok"] is False
