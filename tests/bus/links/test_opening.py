"""Opening the bus: errors name the obstacle, and closing never hangs."""

import socket
import subprocess
import sys
import threading
from typing import Literal

import pytest

from protocol.bus import certificate, session
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import Role
from runtime.errors import (
    EndpointError,
    EndpointInUseError,
    LocalError,
    NoPeerError,
    PeerHangsError,
    UserError,
)
from tests.support.bus.nets import TOPOLOGIES, Topology, net
from tests.support.until import PATIENCE_S, until

ANY_PORT = Network(mode="peer", listen=("tcp/127.0.0.1:0",))
NOBODY_THERE = "tcp/127.0.0.1:1"


def test_the_port_behind_a_zero_is_known() -> None:
    with open_bus(ANY_PORT, Role.ROBOT, "r1") as bus:
        assert bus.locator().startswith("tcp/127.0.0.1:")
        assert not bus.locator().endswith(":0")


def test_bus_without_a_listener_has_no_locator() -> None:
    with open_bus(Network(mode="peer"), None, "r1") as bus, pytest.raises(LocalError):
        bus.locator()


def test_an_endpoint_in_use_is_named() -> None:
    with open_bus(ANY_PORT, Role.ROBOT, "r1") as bus:
        taken = bus.locator()
        with pytest.raises(EndpointInUseError, match=taken):
            open_bus(Network(mode="peer", listen=(taken,)), Role.ROBOT, "r1")


def test_missing_peer_error_names_endpoint_and_remedy() -> None:
    network = Network(mode="client", connect=(NOBODY_THERE,), connect_timeout_s=0.05)
    with pytest.raises(NoPeerError, match=rf"{NOBODY_THERE} .*waited 0\.05 s.* start") as caught:
        open_bus(network, Role.PLANT, "r1")
    assert caught.value.exit_code == 2


def test_silent_listener_is_reported_as_hung(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "SLOW_DIAL_S", 0.2)
    monkeypatch.setattr(certificate, "HANDSHAKE_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        endpoint = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        network = Network(mode="client", connect=(endpoint,), connect_timeout_s=0.2)
        with pytest.raises(
            PeerHangsError, match=f"listens at {endpoint} but does not answer.*hangs"
        ):
            open_bus(network, Role.GROUND, "r1")


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_an_unknown_host_is_named(mode: Literal["client", "peer"]) -> None:
    unknown = ("tcp/no-such-host.invalid:7447",)
    if mode == "client":
        network = Network(mode=mode, connect=unknown, connect_timeout_s=0.05)
    else:
        network = Network(mode=mode, listen=unknown)
    with pytest.raises(UserError, match=unknown[0]) as caught:
        open_bus(network, Role.ROBOT, "r1")
    assert caught.value.exit_code == 2


def test_an_address_of_another_machine_cannot_be_listened_on() -> None:
    with pytest.raises(EndpointError, match=r"tcp/192\.0\.2\.1:7447") as caught:
        open_bus(Network(mode="peer", listen=("tcp/192.0.2.1:7447",)), None, "r1")
    assert ".rs" not in str(caught.value), "source locations of a library do not help a user"


def test_a_bad_robot_name_is_refused_before_anything_is_opened() -> None:
    with pytest.raises(UserError, match="robot name 'R 1'"):
        open_bus(ANY_PORT, Role.ROBOT, "R 1")


def test_a_client_waits_for_a_hub_that_starts_later() -> None:
    with open_bus(ANY_PORT, Role.ROBOT, "r1") as bus:
        endpoint = bus.locator()
    opened: list[str] = []

    def dial() -> None:
        network = Network(mode="client", connect=(endpoint,), connect_timeout_s=PATIENCE_S)
        with open_bus(network, Role.PLANT, "r1") as late:
            opened.append(late.zid)

    dialling = threading.Thread(target=dial)
    dialling.start()
    with open_bus(Network(mode="peer", listen=(endpoint,)), Role.ROBOT, "r1"):
        dialling.join(timeout=PATIENCE_S)
        assert opened


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_watcher_always_sees_all_present_processes(topology: Topology) -> None:
    with net(topology) as bus:
        bus.ground.watch(lambda who, came: None)
        bus.robot.announce()
        bus.plant.announce()
        until(lambda: len(bus.ground.present()) == 2)
        assert {len(bus.ground.present()) for _ in range(200)} == {2}


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_presence_query_always_returns_all_processes(topology: Topology) -> None:
    with net(topology) as bus:
        bus.robot.announce()
        bus.plant.announce()
        until(lambda: len(bus.ground.present()) == 2)
        assert {len(bus.ground.present()) for _ in range(200)} == {2}


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_presence_follows_the_process(topology: Topology) -> None:
    with net(topology) as bus:
        seen: list[tuple[str, str, bool]] = []
        bus.ground.watch(lambda who, came: seen.append((who.robot, who.role, came)))
        bus.robot.announce()
        bus.plant.announce()
        until(lambda: len(bus.ground.present()) == 2)
        assert {(who.robot, who.role) for who in bus.ground.present()} == {
            ("r1", "robot"),
            ("r1", "plant"),
        }
        bus.plant.close()
        until(lambda: ("r1", "plant", False) in seen)
        assert [who.zid for who in bus.ground.present()] == [bus.robot.zid]


def test_bus_without_a_role_cannot_announce() -> None:
    with net() as bus, pytest.raises(LocalError, match="without a role"):
        bus.join(None).announce()


LEFT_OPEN = """
from protocol.bus import session
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.bus.tls import certificate_advice
from protocol.topics import COMMAND, WHEELS, Role
bus = open_bus(Network(mode="peer", listen=("tcp/127.0.0.1:0",)), Role.ROBOT, "r1")
bus.mailbox(WHEELS)
bus.serve(COMMAND, lambda asked: None)
bus.announce()
raise SystemExit(3)
"""


def test_unclosed_bus_lets_the_process_exit_silently() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", LEFT_OPEN],
        timeout=PATIENCE_S,
        capture_output=True,
        check=False,
        env={"RUST_LOG": "debug", "PYTHONPATH": ":".join(sys.path)},
    )
    assert (ended.returncode, ended.stdout) == (3, b""), ended.stderr.decode()
