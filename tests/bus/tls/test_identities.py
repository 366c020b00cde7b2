"""A session id is no identity: who takes another one's place is refused, and keeps nobody out."""

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
import zenoh

from checks.harness.relays import TcpProxy
from ground.cli.main import main
from protocol.bus import bus as bus_module
from protocol.bus.audit import audited_connections
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Mode, Network
from protocol.bus.peers import ID_TAKEN, MAX_IDS, Identities, RefusedLink
from protocol.bus.session import SILENT_S, configured
from protocol.topics import STATUS, STOP, TEXT, WHEELS, Role
from protocol.wire.enums import Command, Vehicle
from protocol.wire.messages import CommandRequest, WheelTicks
from tests.support.bus.robots import PlayedRobot
from tests.support.keyring import Keyring
from tests.support.until import PATIENCE_S, until

PRESS = CommandRequest(request_id=7, param1=1.0, param2=0.0, command=Command.DO_FLIGHTTERMINATION)
TICKS = WheelTicks(time_ns=1, seq=1, left=2, right=-3, bumper=0, expired=0)
OPERATORS = ("ada",)


@pytest.fixture
def ring(tmp_path: Path) -> Keyring:
    return Keyring(tmp_path / "ring")


def listening(ring: Keyring, name: str, endpoint: str = "tls/127.0.0.1:0") -> Network:
    """Return the network of a process that listens; it leaves Zenoh's log alone."""
    mode: Mode = "router" if name == "router" else "peer"
    tls = replace(ring.tls(name), tell_refusals=False)
    return Network(mode=mode, listen=(endpoint,), tls=tls, operators=OPERATORS)


def dialling(ring: Keyring, name: str, endpoint: str) -> Network:
    return Network(
        mode="client",
        connect=(endpoint,),
        tls=ring.tls(name),
        operators=OPERATORS,
        connect_timeout_s=PATIENCE_S,
    )


@contextmanager
def squatting(ring: Keyring, endpoint: str, zid: str, name: str = "viewer") -> Iterator[None]:
    """Open a session with the certificate `name` and the id of another session."""
    config = configured(dialling(ring, name, endpoint), PATIENCE_S, 10_000)
    config.insert_json5("id", json.dumps(zid))
    with zenoh.open(config):
        yield


def unlinked(bus: Bus) -> Callable[[], bool]:
    return lambda: not list(bus._session.info.links())


def hears(bus: Bus) -> Callable[[], bool]:
    """Return whether the bus has received a status since this call."""
    box = bus.mailbox(STATUS)
    before = box.latest()
    return lambda: box.latest() != before


def stops(operator: Bus, robot: PlayedRobot) -> None:
    """Press the emergency stop until the robot shows it."""
    publisher = operator.publisher(STOP)

    def pressed() -> bool:
        publisher.put(PRESS)
        return robot.vehicle == Vehicle.EMERGENCY_STOP

    until(pressed, what="the robot stops")


def test_operator_whose_id_a_viewer_takes_stops_the_robot(ring: Keyring) -> None:
    told: list[str] = []
    with (
        open_bus(listening(ring, "robot-r1"), Role.ROBOT, "r1") as hub,
        PlayedRobot(hub) as robot,
        audited_connections(hub, told.append),
        TcpProxy(hub.locator()) as relay,
        open_bus(dialling(ring, "ground-ada", relay.endpoint), Role.GROUND, "r1") as ada,
    ):
        until(hears(ada))
        relay.cut()
        until(unlinked(hub))
        with squatting(ring, hub.locator(), ada.zid):
            relay.restore()
            until(hears(ada), what="ada hears the robot again")
            stops(ada, robot)
        until(lambda: told, what="the refusal is reported")
    assert told[0].startswith(f"{ID_TAKEN}viewer at 127.0.0.1 used {ada.zid}, which ground-ada")
    assert len([line for line in told if ID_TAKEN in line]) == 1


def test_rightful_owner_of_an_id_is_admitted_after_a_refusal(ring: Keyring) -> None:
    refused: list[RefusedLink] = []
    with open_bus(listening(ring, "robot-r1"), Role.ROBOT, "r1") as hub:
        hub.on_refused(refused.append)
        with squatting(ring, hub.locator(), "ada1", "ground-ada"):
            pass
        until(unlinked(hub))
        with squatting(ring, hub.locator(), "ada1"):
            until(lambda: refused)
        with squatting(ring, hub.locator(), "ada1", "ground-ada"):
            names = {link.auth_identifier for link in hub._session.info.links()}
    assert names == {"ground-ada"}
    assert {(one.zid, one.name, one.holder) for one in refused} == {
        ("ada1", "viewer", "ground-ada")
    }


def test_id_taken_at_a_restarted_robot_gets_a_fresh_session(ring: Keyring) -> None:
    """After a restart the robot cannot know whose the id is: the operator takes another one."""
    with ExitStack() as first:
        hub = first.enter_context(open_bus(listening(ring, "robot-r1"), Role.ROBOT, "r1"))
        endpoint = hub.locator()
        relay = first.enter_context(TcpProxy(endpoint))
        network = dialling(ring, "ground-ada", relay.endpoint)
        ada = open_bus(network, Role.GROUND, "r1")
        news: list[str] = []
        ada.on_impostor(news.append)
        ada.announce()
        identity, box = ada.operator, ada.mailbox(STATUS)
        relay.cut()
        until(unlinked(ada))
        hub.close()
        with (
            ada,
            open_bus(listening(ring, "robot-r1", endpoint), Role.ROBOT, "r1") as again,
            PlayedRobot(again) as robot,
            squatting(ring, endpoint, ada.zid),
        ):
            relay.restore()
            until(box.latest, what="ada hears the robot again")
            stops(ada, robot)
            assert str(ada._session.zid()) != ada.zid
            assert ada.operator == identity
            who = {(token.role, token.zid) for token in again.present()}
            assert ("ground", ada.zid) in who, "it is announced under its old id"
    assert "accepts connections, but the link did not come back: a fresh session" in news[0]


@pytest.mark.parametrize("restarts", [False, True])
@pytest.mark.parametrize("name", ["plant", "robot-r1"])
def test_process_behind_a_router_whose_id_is_taken_returns(
    ring: Keyring, name: str, monkeypatch: pytest.MonkeyPatch, *, restarts: bool
) -> None:
    monkeypatch.setattr(bus_module, "KEEPER_SILENT_S", SILENT_S)
    role = Role.PLANT if name == "plant" else Role.ROBOT
    with ExitStack() as scope:
        router = open_bus(listening(ring, "router"), None, "router")
        endpoint = router.locator()
        relay = scope.enter_context(TcpProxy(endpoint))
        bus = scope.enter_context(open_bus(dialling(ring, name, relay.endpoint), role, "r1"))
        bus.announce()
        relay.cut()
        until(unlinked(bus))
        until(unlinked(router))
        if restarts:
            router.close()
            router = open_bus(listening(ring, "router", endpoint), None, "router")
        scope.enter_context(router)
        reader = scope.enter_context(
            open_bus(dialling(ring, "ground-ada", endpoint), Role.GROUND, "r1")
        )
        scope.enter_context(squatting(ring, endpoint, bus.zid))
        relay.restore()
        topic, message = (WHEELS, TICKS) if role is Role.PLANT else (TEXT, None)
        box = reader.mailbox(topic)
        publisher = bus.publisher(topic)

        def arrives() -> bool:
            publisher.put_frame(b"x" if message is None else publisher.frame(message))
            return box.latest() is not None or box.rejected > 0

        until(arrives, what="the process is heard again")
        until(lambda: (role.value, bus.zid) in {(one.role, one.zid) for one in reader.present()})


def test_doctor_names_the_id_and_both_certificates(
    ring: Keyring, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    told: list[str] = []
    with (
        open_bus(listening(ring, "robot-r1"), Role.ROBOT, "r1") as hub,
        PlayedRobot(hub),
        audited_connections(hub, told.append),
    ):
        with squatting(ring, hub.locator(), "ada1", "ground-ada"):
            pass
        until(unlinked(hub))
        with squatting(ring, hub.locator(), "ada1"):
            until(lambda: told)
        file = tmp_path / "ground.toml"
        tls = ring.tls("ground")
        file.write_text(
            f'[network]\nconnect = ["{hub.locator()}"]\n[network.tls]\nca = "{tls.ca}"\n'
            f'certificate = "{tls.certificate}"\nkey = "{tls.key}"\n'
        )
        main(["doctor", "--timeout", "0.5", "--json", "--config", str(file)])
        found = json.loads(capsys.readouterr().out)["findings"]
    (finding,) = [one for one in found if one["what"].startswith(ID_TAKEN)]
    assert "viewer at 127.0.0.1 used ada1, which ground-ada has used first" in finding["what"]
    assert "keys revoke" in finding["do"]
    assert not finding["bad"]


def test_an_id_belongs_to_the_certificate_that_used_it_first() -> None:
    known = Identities()
    assert known.linked("1", "ground-ada", "a:1") is None
    assert known.linked("1", "viewer", "b:1") == RefusedLink("1", "viewer", "b:1", "ground-ada")
    known.unlinked("1", "b:1")
    known.unlinked("1", "a:1")
    assert known.linked("1", "viewer", "b:2") is not None
    assert known.linked("1", "ground-ada", "a:2") is None


def test_certificate_with_many_ids_pushes_out_only_its_own() -> None:
    known = Identities()
    known.linked("ada", "ground-ada", "a:1")
    known.unlinked("ada", "a:1")
    for number in range(3 * MAX_IDS):
        known.linked(f"v{number}", "viewer", f"b:{number}")
        known.unlinked(f"v{number}", f"b:{number}")
    assert known.linked("ada", "viewer", "b:0") is not None
    assert known.linked(f"v{3 * MAX_IDS - 1}", "ground-ada", "a:2") is not None
    assert known.linked("v0", "ground-ada", "a:3") is None, "forgotten"
    assert len(known._holders) <= 2 * MAX_IDS


def test_linked_id_is_never_forgotten() -> None:
    known = Identities()
    known.linked("first", "viewer", "b:1")
    for number in range(3 * MAX_IDS):
        known.linked(f"v{number}", "viewer", f"c:{number}")
        known.unlinked(f"v{number}", f"c:{number}")
    assert known.linked("first", "ground-ada", "a:1") is not None
