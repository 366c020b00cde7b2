"""A process that dials believes a router or its own robot, and no other holder of a certificate."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import zenoh
from zenoh.handlers import Callback

from ground.cli.main import main
from protocol.bus.audit import audited_connections
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Hub, Network
from protocol.bus.session import configured
from protocol.topics import COMMAND, OPERATOR, SONAR, STATUS, STOP, Role
from runtime.errors import AccessDeniedError
from tests.support.bus.locked import SESSION
from tests.support.keyring import Keyring
from tests.support.until import PATIENCE_S, until

PREFIX = "impostor"
DIAL_S = 2.0
BEFORE = "before"
"""Session of the operator at the true router, whose last frames may arrive late."""

BESIDE = ("sense/sonar", "op/heartbeat/ground/abc", "op/stop/ground/abc", "srv/command/ground/abc")


@pytest.fixture
def ring(tmp_path: Path) -> Keyring:
    return Keyring(tmp_path / "ring")


@contextmanager
def listening(ring: Keyring, name: str, port: int = 0) -> Iterator[tuple[zenoh.Session, int]]:
    """Open a router with the key `name` and no access control; yield its session and port."""
    network = Network(mode="router", listen=(f"tls/127.0.0.1:{port}",), tls=ring.tls(name))
    config = configured(network, DIAL_S)
    config.insert_json5("access_control", '{"enabled": false}')
    with zenoh.open(config) as session:
        (link,) = (
            one.ok.payload.to_bytes()
            for one in session.get(f"@/{session.zid()}/*", timeout=PATIENCE_S)
            if one.ok is not None
        )
        yield session, int(json.loads(link)["locators"][0].rpartition(":")[2])


def dialling(ring: Keyring, name: str, port: int) -> Network:
    return Network(
        mode="client",
        connect=(f"tls/127.0.0.1:{port}",),
        prefix=PREFIX,
        tls=ring.tls(name),
        connect_timeout_s=DIAL_S,
    )


def opened(ring: Keyring, name: str, port: int) -> Bus:
    roles = {"ground": Role.GROUND, "plant": Role.PLANT, "robot-r1": Role.ROBOT}
    return open_bus(dialling(ring, name, port), roles.get(name), "r1")


@pytest.mark.parametrize("name", ["robot-r1", "ground", "plant", "viewer"])
def test_another_robot_where_the_router_is_dialled_is_refused(ring: Keyring, name: str) -> None:
    with listening(ring, "robot-r2") as (_, port):
        with pytest.raises(
            AccessDeniedError, match=r"shows the certificate of 'robot-r2', and "
        ) as caught:
            opened(ring, name, port)
        assert f"tls/127.0.0.1:{port}" in caught.value.why


def test_robot_rejects_its_own_certificate_at_the_router(ring: Keyring) -> None:
    with listening(ring, "robot-r1") as (_, port):
        with pytest.raises(AccessDeniedError, match="robot-r1 dials only a router"):
            opened(ring, "robot-r1", port)
        opened(ring, "ground", port).close()


def test_a_router_whose_certificate_is_revoked_is_refused(ring: Keyring) -> None:
    with listening(ring, "router") as (_, port):
        network = replace(dialling(ring, "robot-r1", port), revoked=("router",))
        with pytest.raises(AccessDeniedError, match="certificate of 'router', which is revoked"):
            open_bus(network, Role.ROBOT, "r1")


class Robot:
    """Record the keys of all samples and requests that robot r1 accepts, from any sender."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.came: list[str] = []
        bus.serve(COMMAND, lambda asked: self.came.append(asked.key))
        bus.serve_stop(lambda operator, _: self.came.append(operator), lambda _: None)
        for key in (SONAR.path, f"{OPERATOR.path}/**"):
            declare = partial(zenoh.Session.declare_subscriber, key_expr=bus.key(key))
            bus._declare(partial(declare, handler=noting(self.came)))


def noting(keys: list[str]) -> Any:
    """Return a callback that appends the key of each sample."""
    return Callback(lambda sample: keys.append(str(sample.key_expr)), indirect=False)


def arrived(router: zenoh.Session, robot: Robot) -> bool:
    """Pass on a heartbeat of the operator; whether one has arrived."""
    router.put(f"{PREFIX}/r1/{OPERATOR.path}/ground/{BEFORE}", b"beat")
    return bool(robot.came)


def attack(session: zenoh.Session) -> None:
    """Put and ask everything that makes a robot drive, and wait until it could have arrived."""
    for path in BESIDE:
        session.put(f"{PREFIX}/r1/{path}", b"x", congestion_control=zenoh.CongestionControl.BLOCK)
        assert list(session.get(f"{PREFIX}/r1/{path}", timeout=PATIENCE_S)) == []


def test_impostor_sends_and_receives_nothing_on_reconnect(ring: Keyring) -> None:
    """Link a robot to its router, then replace the router by one with another robot's key."""
    told: list[str] = []
    with listening(ring, "router") as (router, port):
        bus = opened(ring, "robot-r1", port)
        robot = Robot(bus)
        until(lambda: arrived(router, robot))
    with (
        bus,
        audited_connections(bus, told.append),
        listening(ring, "robot-r2", port) as (rogue, _),
    ):
        heard: list[str] = []
        note = noting(heard)
        rogue.declare_subscriber(f"{PREFIX}/**", note, allowed_origin=zenoh.Locality.REMOTE)
        until(lambda: told)
        assert "shows the certificate of 'robot-r2', and robot-r1 dials only a router" in told[0]
        bus._session.put(bus.key(STATUS.path), b"status")
        attack(rogue)
        assert {key.rpartition("/")[2] for key in robot.came} == {BEFORE}
        assert heard == []
        assert bus.hub() is Hub.HANGS
        assert told[0] in bus.lost()


def test_a_router_that_comes_back_is_believed_again(ring: Keyring) -> None:
    told: list[str] = []
    with listening(ring, "router") as (_, port):
        bus = opened(ring, "robot-r1", port)
        robot = Robot(bus)
    with bus:
        bus.on_impostor(told.append)
        with listening(ring, "robot-r2", port):
            until(lambda: told)
        with listening(ring, "router", port) as (router, _):
            until(lambda: arrived(router, robot))
            assert bus.hub() is Hub.ROUTER


def test_robot_accepts_only_robot_topics_from_a_router(ring: Keyring) -> None:
    """Apply the robot's own access list even if the router forwards everything."""
    with listening(ring, "router") as (router, port), opened(ring, "robot-r1", port) as bus:
        came: list[str] = []
        bus._declare(lambda one: one.declare_subscriber(f"{PREFIX}/**", noting(came)))
        good = f"{PREFIX}/r1/{STOP.path}/ground/{SESSION}"

        def arrives() -> bool:
            for key in (f"{PREFIX}/r2/{SONAR.path}", f"{PREFIX}/r1/truth/pose", f"{PREFIX}/r1/*/*"):
                router.put(key, b"x")
            router.put(good, b"x")
            return bool(came)

        until(arrives)
        assert set(came) == {good}


def test_the_doctor_finds_a_stack_behind_an_impostor_ill(
    ring: Keyring, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with listening(ring, "robot-r2") as (_, port):
        tls = ring.tls("ground")
        file = tmp_path / "ground.toml"
        file.write_text(
            f'[network]\nconnect = ["tls/127.0.0.1:{port}"]\n[network.tls]\nca = "{tls.ca}"\n'
            f'certificate = "{tls.certificate}"\nkey = "{tls.key}"\n'
        )
        assert main(["doctor", "--timeout", "0.1", "--json", "--config", str(file)]) == 1
        told = json.loads(capsys.readouterr().out)
        assert told["ok"] is False
        (finding,) = told["findings"]
        assert "shows the certificate of 'robot-r2'" in finding["what"]
        assert "find out which process listens there" in finding["do"]
