"""Access with TLS: a certificate allows only its role, and no session takes another's place."""

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import zenoh
from zenoh.handlers import Callback

from checks.harness.relays import TcpProxy
from checks.harness.until import PATIENCE_S, until
from ground.cli.main import main
from protocol.bus import bus as bus_module
from protocol.bus.audit import audited_connections
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Hub, Mode, Network
from protocol.bus.peers import ID_TAKEN, MAX_IDS, Identities, RefusedLink
from protocol.bus.rights import GATEWAY_ASKS, GATEWAY_PUTS, GATEWAY_RECEIVES, operator_name
from protocol.bus.session import SILENT_S, configured
from protocol.topics import (
    COMMAND,
    DRIVE,
    OPERATOR,
    SERVICES,
    SONAR,
    STATUS,
    STOP,
    TEXT,
    TOPICS,
    TRUTH,
    WHEELS,
    Role,
)
from protocol.wire.enums import Command, Vehicle
from protocol.wire.messages import CommandRequest, WheelTicks
from runtime.errors import AccessDeniedError
from tests.support.networks import (
    SESSION,
    TOPOLOGIES,
    Intruder,
    Keyring,
    Locked,
    Topology,
    Watchful,
    locked,
)
from tests.support.played_robot import PlayedRobot

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


def test_id_that_two_certificates_have_used_is_refused_to_both(ring: Keyring) -> None:
    refused: list[RefusedLink] = []
    with open_bus(listening(ring, "robot-r1"), Role.ROBOT, "r1") as hub:
        hub.on_refused(refused.append)
        with squatting(ring, hub.locator(), "ada1", "ground-ada"):
            pass
        until(unlinked(hub))
        with squatting(ring, hub.locator(), "ada1"):
            until(lambda: refused)
        until(unlinked(hub))
        with squatting(ring, hub.locator(), "ada1", "ground-ada"):
            until(unlinked(hub))
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

        until(arrives, what="the process is heard again", poll_s=0.05)
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
    assert known.linked("1", "ground-ada", "a:2") is not None, "Zenoh may mix up the two"
    assert known.linked("2", "ground-ada", "a:3") is None


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


AT_LEAST = 1000
OURS = {
    "ground": ("op/",),
    "ground-bob": ("op/",),
    "plant": ("sense/", "truth/"),
    "viewer": (),
    "recorder": (),
    "gateway": ("op/heartbeat", "op/teleop", "op/stop", "op/gateway"),
    "robot-r2": (),
    "stranger": (),
}
"""What each may publish of robot r1, by the beginning of its path."""

MAY_ASK = {
    "ground": ("srv/", "sim/"),
    "ground-bob": ("srv/", "sim/"),
    "viewer": ("srv/parameters", "sim/world"),
    "recorder": ("srv/parameters", "sim/world"),
    "gateway": ("srv/",),
}
WILD = (
    "{p}/**",
    "**",
    "*/**",
    "{p}/*/**",
    "{p}/r1/**",
    "{p}/r1/*/*",
    "{p}/*/op/heartbeat",
    "{p}/r1/op/*",
    "{p}/*/sense/*",
    "{p}/$*1/sense/sonar",
    "{p}/r1/**/wheels",
    "{p}/**/command",
    "{p}/*/srv/command",
    "{p}/r1/srv/*",
    "{p}/r1/s$*/**",
    "*/r1/tlm/status",
    "@/**",
    "{p}/r1/op/**",
    "{p}/r1/op/*/*/*",
    "{p}/r1/op/stop/**",
    "{p}/r1/op/heartbeat/*/abc",
    "{p}/*/op/stop/ground/abc",
    "{p}/r1/srv/command/**",
    "{p}/r1/srv/stop/*/abc",
    "{p}/*/srv/command/ground/abc",
)


def forbidden(net: Locked, name: str, path: str, own: tuple[str, ...]) -> set[str]:
    """Return the keys of a path that are not for the holder of a certificate.

    `own` are the beginnings of the paths of which it may use the key under its own name.
    """
    operator = operator_name(name)
    names = ("ground", "ada", "bob", operator or "ground")
    every = {net.plain(path), *(net.key(path, operator=one) for one in names)}
    allowed = net.plain(path) if operator is None else net.key(path, operator=operator)
    return every - {allowed} if path.startswith(own or ("-",)) else every


def intrude(net: Locked, name: str, intruder: Intruder) -> None:
    """Everything that the holder of this certificate may not do to robot r1."""
    for path in (topic.path for topic in TOPICS):
        for key in forbidden(net, name, path, own=OURS[name]):
            intruder.put(key)
            intruder.put_declared(key)
            intruder.delete(key)
    for path in (service.path for service in SERVICES):
        for key in forbidden(net, name, path, own=MAY_ASK.get(name, ())):
            intruder.put(key)
            intruder.ask(key)
    for pattern in WILD:
        key = pattern.format(p=net.prefix)
        for way in intruder.ways:
            way(key)


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_of_a_thousand_forgeries_none_arrives(topology: Topology, tmp_path: Path) -> None:
    tried = 0
    with locked(topology, tmp_path / "ring") as net:
        watchful = Watchful(net)
        for name in OURS:
            for mode in ("client", "peer"):
                intruder = Intruder(net.join(name, mode))
                intrude(net, name, intruder)
                intruder.ask(net.key(COMMAND.path, "r2"))  # answered when all before is done with
                assert intruder.answered == [], f"{name} as {mode}"
                tried += intruder.tried
        assert watchful.forged == []
        what_is_allowed_arrives(net, watchful)
    assert tried >= AT_LEAST


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_a_revoked_certificate_may_do_nothing_though_it_is_valid(
    topology: Topology, tmp_path: Path
) -> None:
    with locked(topology, tmp_path / "ring", revoked=("ground-bob",)) as net:
        watchful = Watchful(net)
        for name, arrives in (("ground-bob", False), ("ground-ada", True)):
            intruder = Intruder(net.join(name))
            operator = name.removeprefix("ground-")
            intruder.put(net.key(OPERATOR.path, operator=operator))
            until(partial(asked, intruder, net.key(COMMAND.path, operator=operator), arrives))
            assert bool(watchful.forged) is bool(intruder.answered) is arrives


def asked(intruder: Intruder, key: str, arrives: bool) -> bool:
    """Send a request; return true if it was answered or no answer is expected."""
    intruder.ask(key)
    return not arrives or bool(intruder.answered)


def what_is_allowed_arrives(net: Locked, watchful: Watchful) -> None:
    before = watchful.good
    net.ground.put(net.key(OPERATOR.path), b"beat")
    net.plant.put(net.key(SONAR.path), b"scan")
    net.robot.put(net.key(STATUS.path), b"status")
    assert answers(net) == [b"done"]
    gateway = net.member("gateway")
    for topic in GATEWAY_PUTS:
        gateway.put(net.key(topic.path, operator="gateway"), b"sample")
    for service in GATEWAY_ASKS:
        key = net.key(service.path, operator="gateway")
        replies = [reply.ok for reply in gateway.get(key, payload=b"go", timeout=PATIENCE_S)]
        assert [one and one.payload.to_bytes() for one in replies] == [b"done"], key
    until(lambda: watchful.good >= before + 4 + len(GATEWAY_PUTS) + len(GATEWAY_ASKS))


@pytest.mark.parametrize("topology", TOPOLOGIES)
@pytest.mark.parametrize("name", ["viewer", "plant", "gateway", "robot-r2", "stranger"])
def test_only_the_robot_may_answer_its_services(
    topology: Topology, name: str, tmp_path: Path
) -> None:
    with locked(topology, tmp_path / "ring") as net:
        intruder = Intruder(net.join(name))
        for key in (net.key(COMMAND.path), net.key("srv/*"), f"{net.prefix}/**", "**"):
            intruder.serve(key)
        intruder.ask(net.key(COMMAND.path, "r2"))
        assert answers(net) == []
        Watchful(net)
        until(lambda: answers(net) == [b"done"])


def answers(net: Locked) -> list[bytes]:
    """Return the answers that the ground station receives to a command."""
    replies = net.ground.get(net.key(COMMAND.path), payload=b"go", timeout=PATIENCE_S)
    return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_presence_of_another_role_is_rejected(topology: Topology, tmp_path: Path) -> None:
    with locked(topology, tmp_path / "ring") as net:
        tokens = [
            net.join(name).liveliness().declare_token(net.key(f"alive/{role}/1"))
            for name, role in (
                ("viewer", "robot"),
                ("robot-r2", "robot"),
                ("plant", "robot"),
                ("ground", "plant"),
                ("gateway", "robot"),
                ("gateway", "plant"),
                ("stranger", "robot"),
            )
        ]
        tokens.append(net.plant.liveliness().declare_token(net.key("alive/plant/2")))
        everybody = f"{net.prefix}/*/alive/*/*"
        until(lambda: list(net.ground.liveliness().get(everybody, timeout=PATIENCE_S)))
        seen = [reply.ok for reply in net.ground.liveliness().get(everybody, timeout=PATIENCE_S)]
        assert [str(one.key_expr) for one in seen if one] == [net.key("alive/plant/2")]


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_each_role_receives_only_its_topics(topology: Topology, tmp_path: Path) -> None:
    with locked(topology, tmp_path / "ring") as net:
        heard: dict[str, set[str]] = {}
        for name in ("viewer", "gateway", "robot-r2", "stranger", "plant"):
            hears = heard.setdefault(name, set())
            session = net.join(name)
            for key in (f"{net.prefix}/**", "**", *(net.every(topic.path) for topic in TOPICS)):
                listening = Callback(partial(note, hears), indirect=False)
                session.declare_subscriber(key, listening)
            Intruder(session).ask(net.key(COMMAND.path, "r2"))
        senders = {Role.ROBOT: net.robot, Role.PLANT: net.plant, Role.GROUND: net.ground}
        all_keys = {net.key(topic.path) for topic in TOPICS}

        own = {net.key(topic.path) for topic in TOPICS if topic.publisher is Role.PLANT}
        of_the_plant = {net.key(DRIVE.path), *own}
        of_the_gateway = {net.key(topic.path) for topic in GATEWAY_RECEIVES}

        def everybody_heard() -> bool:
            for topic in TOPICS:
                senders[topic.publisher].put(net.key(topic.path), b"x")
            complete = heard["plant"] >= of_the_plant and heard["gateway"] >= of_the_gateway
            return complete and heard["viewer"] == all_keys

        until(everybody_heard)
        assert heard["robot-r2"] == heard["stranger"] == set()
        assert heard["plant"] == of_the_plant
        assert heard["gateway"] == of_the_gateway


def note(keys: set[str], sample: zenoh.Sample) -> None:
    keys.add(str(sample.key_expr))


def test_robot_does_not_receive_ground_truth(tmp_path: Path) -> None:
    with locked("router", tmp_path / "ring") as net:
        heard: set[str] = set()
        for key in (net.key("**"), *(net.key(topic.path) for topic in TOPICS)):
            net.robot.declare_subscriber(key, Callback(partial(note, heard), indirect=False))

        def scan_heard() -> bool:
            for path in (TRUTH.path, SONAR.path):
                net.plant.put(net.key(path), b"x")
            return net.key(SONAR.path) in heard

        until(scan_heard)
        assert heard == {net.key(SONAR.path)}


PREFIX = "impostor"
DIAL_S = 2.0
BEFORE = "before"
"""Session of the operator at the true router, whose last frames may arrive late."""

BESIDE = ("sense/sonar", "op/heartbeat/ground/abc", "op/stop/ground/abc", "srv/command/ground/abc")


@contextmanager
def impostor_listening(
    ring: Keyring, name: str, port: int = 0
) -> Iterator[tuple[zenoh.Session, int]]:
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


def impostor_dialling(ring: Keyring, name: str, port: int) -> Network:
    return Network(
        mode="client",
        connect=(f"tls/127.0.0.1:{port}",),
        prefix=PREFIX,
        tls=ring.tls(name),
        connect_timeout_s=DIAL_S,
    )


def opened(ring: Keyring, name: str, port: int) -> Bus:
    roles = {"ground": Role.GROUND, "plant": Role.PLANT, "robot-r1": Role.ROBOT}
    return open_bus(impostor_dialling(ring, name, port), roles.get(name), "r1")


@pytest.mark.parametrize("name", ["robot-r1", "ground", "plant", "viewer"])
def test_another_robot_where_the_router_is_dialled_is_refused(ring: Keyring, name: str) -> None:
    with impostor_listening(ring, "robot-r2") as (_, port):
        with pytest.raises(
            AccessDeniedError, match=r"shows the certificate of 'robot-r2', and "
        ) as caught:
            opened(ring, name, port)
        assert f"tls/127.0.0.1:{port}" in caught.value.why


def test_robot_rejects_its_own_certificate_at_the_router(ring: Keyring) -> None:
    with impostor_listening(ring, "robot-r1") as (_, port):
        with pytest.raises(AccessDeniedError, match="robot-r1 dials only a router"):
            opened(ring, "robot-r1", port)
        opened(ring, "ground", port).close()


def test_a_router_whose_certificate_is_revoked_is_refused(ring: Keyring) -> None:
    with impostor_listening(ring, "router") as (_, port):
        network = replace(impostor_dialling(ring, "robot-r1", port), revoked=("router",))
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
    with impostor_listening(ring, "router") as (router, port):
        bus = opened(ring, "robot-r1", port)
        robot = Robot(bus)
        until(lambda: arrived(router, robot))
    with (
        bus,
        audited_connections(bus, told.append),
        impostor_listening(ring, "robot-r2", port) as (rogue, _),
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
    with impostor_listening(ring, "router") as (_, port):
        bus = opened(ring, "robot-r1", port)
        robot = Robot(bus)
    with bus:
        bus.on_impostor(told.append)
        with impostor_listening(ring, "robot-r2", port):
            until(lambda: told)
        with impostor_listening(ring, "router", port) as (router, _):
            until(lambda: arrived(router, robot))
            assert bus.hub() is Hub.ROUTER


def test_robot_accepts_only_robot_topics_from_a_router(ring: Keyring) -> None:
    """Apply the robot's own access list even if the router forwards everything."""
    with (
        impostor_listening(ring, "router") as (router, port),
        opened(ring, "robot-r1", port) as bus,
    ):
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
    with impostor_listening(ring, "robot-r2") as (_, port):
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
