"""Access control with TLS: a certificate allows only its role, without wildcards or forgery."""

from functools import partial
from pathlib import Path

import pytest
import zenoh
from zenoh.handlers import Callback

from protocol.bus.rights import (
    GATEWAY_ASKS,
    GATEWAY_PUTS,
    GATEWAY_RECEIVES,
    operator_name,
)
from protocol.topics import (
    COMMAND,
    DRIVE,
    OPERATOR,
    SERVICES,
    SONAR,
    STATUS,
    TOPICS,
    TRUTH,
    Role,
)
from tests.support.bus.locked import Intruder, Locked, Watchful, locked
from tests.support.bus.nets import TOPOLOGIES, Topology
from tests.support.until import PATIENCE_S, until

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
