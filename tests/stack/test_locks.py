"""Real processes with mutual TLS: they drive, log refusals, and stop without a session."""

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import zenoh

from checks.flood.under_attack import peak_mb
from checks.harness.crew import Crew, free_endpoint
from checks.harness.processes import Running
from checks.harness.until import until
from ground.certificates import make
from ground.launch.child_command import command
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network, Tls
from protocol.bus.session import configured
from protocol.topics import COMMAND, COMMANDED, ENCODING, LEASE_SERVICE, PREFIX, TELEOP, Role
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import Command, LeaseAction
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, CommandRequest, LeaseRequest
from protocol.wire.reasons import Reason
from runtime.errors import AccessDeniedError
from tests.support.networks import DAY, NOW, Keyring

pytestmark = pytest.mark.stack
EACH = 10
OURS = 1000
PATIENCE_S = 60.0


class Locked(Crew):
    """A crew that listens and dials with the keys of a folder."""

    def __init__(self, keys: Path, *, router: bool = False, lockstep: bool = False) -> None:
        super().__init__(router=router, lockstep=lockstep)
        self.endpoint = self.endpoint.replace("tcp/", "tls/")
        self._keys = keys

    def start(self, *words: str, role: str = "") -> Running:
        owner = {"robot": "robot-r1", "plant": "plant", "router": "router"}
        role = role or owner.get(words[0], "ground")
        return super().start(*words, "--config", str(self._keys / f"{role}.toml"))

    def verb(self, role: str, *words: str) -> tuple[int, str]:
        """Run a verb to its end with the certificate of a role."""
        running = self.start(*words, "--connect", self.endpoint, role=role)
        return running.ends(PATIENCE_S), running.said


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("locks") / "keys"
    make(folder, ["r1", "r2"], {}, NOW - DAY, NOW + DAY, ["ada", "bob"])
    return folder


def tls_of(keys: Path, role: str) -> Tls:
    return Tls(ca=f"{keys}/ca.pem", certificate=f"{keys}/{role}.pem", key=f"{keys}/{role}.key")


def dialling(endpoint: str, tls: Tls | None) -> Network:
    return Network(
        mode="client",
        connect=(endpoint if tls else endpoint.replace("tls/", "tcp/"),),
        tls=tls,
        connect_timeout_s=1.0,
    )


@pytest.mark.parametrize("router", [False, True], ids=["hub", "router"])
def test_a_stack_behind_locks_drives_and_only_the_ground_station_commands_it(
    keys: Path, router: bool
) -> None:
    with Locked(keys, router=router, lockstep=True) as crew:
        robot = crew.robot()
        crew.plant("--robots", "r1")
        listener = crew.router if router else robot
        watch = crew.start("watch", "--connect", crew.endpoint, role="viewer")
        watch.says("STANDBY")
        code, said = crew.verb("viewer", "arm")
        assert (code, "'viewer', which only observes" in said) == (1, True), said
        listener.says("viewer only observes", PATIENCE_S)
        code, said = crew.verb("ground", "goto", "0.9", "2")
        assert code == 0, said
        code, said = crew.verb("viewer", "doctor")
        assert "healthy" in said, said
        everything = robot.said + listener.said + said
        assert "PRIVATE KEY" not in everything


def test_another_operator_cannot_command_under_the_lease_of_its_holder(keys: Path) -> None:
    """Refuse a lease holder's name from a client whose certificate has another name."""
    with Locked(keys) as crew:
        robot = crew.robot()
        crew.plant()
        with (
            open_bus(dialling(crew.endpoint, tls_of(keys, "ground-ada")), Role.GROUND, "r1") as ada,
            open_bus(dialling(crew.endpoint, tls_of(keys, "ground-bob")), Role.GROUND, "r1") as bob,
            unruly(dialling(crew.endpoint, tls_of(keys, "ground-bob"))) as intruder,
        ):
            acted_on: list[Message] = []
            bob.stream(COMMANDED, lambda _key, frame, _at: acted_on.append(decode(frame).message))
            assert ada.operator is not None
            assert ada.operator.startswith("ada/")
            assert taken(ada, 1) == Reason.NONE
            assert forge(intruder, ada.operator) == 2 * EACH
            assert taken(ada, 2) == Reason.NONE  # for another 3 s
            answer = bob.ask(COMMAND, asking(OURS, Command.DO_PAUSE_CONTINUE), PATIENCE_S)
            assert reason_of(answer) == Reason.LEASE_HELD
            until(lambda: acted_on[2:], what="what the robot was asked")
            asked = [type(one).__name__ for one in acted_on]
            assert asked == ["LeaseRequest", "LeaseRequest", "CommandRequest"]
            robot.says("refused: ground-bob at 127.0.0.1", PATIENCE_S)
            robot.says(f"may not query on sidestep/r1/srv/command/{ada.operator}", PATIENCE_S)
            robot.says(f"may not put on sidestep/r1/op/teleop/{ada.operator}", PATIENCE_S)


def taken(operator: Bus, number: int) -> int:
    """Take the lease; the reason that the robot gives."""
    take = LeaseRequest(request_id=number, action=LeaseAction.TAKE, name="ada")
    return reason_of(operator.ask(LEASE_SERVICE, take, timeout_s=PATIENCE_S))


@pytest.mark.parametrize("role", ["viewer", "plant", "robot-r2"])
def test_a_robot_does_nothing_of_what_others_command(keys: Path, role: str) -> None:
    with Locked(keys) as crew:
        robot = crew.robot()
        crew.plant()
        with (
            unruly(dialling(crew.endpoint, tls_of(keys, role))) as intruder,
            open_bus(dialling(crew.endpoint, tls_of(keys, "ground")), Role.GROUND, "r1") as ground,
        ):
            acted_on: list[Message] = []
            ground.stream(
                COMMANDED, lambda _key, frame, _at: acted_on.append(decode(frame).message)
            )
            assert forge(intruder) == 2 * EACH
            ground.ask(COMMAND, asking(OURS), timeout_s=PATIENCE_S)
            until(lambda: acted_on, what="what the robot acted on")
            assert acted_on == [asking(OURS)]
            robot.says("may not query on sidestep/r1/srv/command", PATIENCE_S)
            robot.says("may not put on sidestep/r1/op/teleop", PATIENCE_S)
            assert acted_on == [asking(OURS)]


DEEP = f"{PREFIX}/r1/" + "a/" * 24 + "b"
WILD = "**/a/" * 12 + "**/c"
"""A key and a pattern: Zenoh 1.10 needs a second and 200 MB to compare them."""

GROWN_AT_MOST_MB = 20.0


@pytest.mark.parametrize(("router", "role"), [(False, "viewer"), (True, "robot-r2")])
def test_patterns_that_others_declare_cost_the_hub_nothing(
    keys: Path, router: bool, role: str
) -> None:
    with Locked(keys, router=router) as crew:
        robot = crew.robot()
        crew.plant("--robots", "r1")
        hub = (crew.router if router else robot).process.pid
        network = dialling(crew.endpoint, tls_of(keys, role))
        # A session of its own for each: Zenoh compares the patterns of one session there, too.
        with unruly(network) as deep, unruly(network) as wild, unruly(network) as many:
            for intruder in (deep, wild, many):
                is_done(intruder)
            before_mb = peak_mb(hub)
            kept = [declare(deep, DEEP)]
            is_done(deep)
            kept.append(declare(wild, f"{PREFIX}/r1/{WILD}"))
            is_done(wild)
            assert peak_mb(hub) - before_mb < GROWN_AT_MOST_MB
            kept += [declare(many, f"{PREFIX}/r1/x{number}/{WILD}") for number in range(250)]
            is_done(many)
            assert peak_mb(hub) - before_mb < GROWN_AT_MOST_MB


def declare(intruder: zenoh.Session, key: str) -> object:
    """Subscribe to a key, serve it, announce it and watch it; the hub refuses all of that."""
    return (
        intruder.declare_subscriber(key, lambda _sample: None),
        intruder.declare_queryable(key, lambda _query: None),
        intruder.liveliness().declare_token(key),
        intruder.liveliness().declare_subscriber(key, lambda _sample: None),
    )


def is_done(intruder: zenoh.Session) -> None:
    """Wait until the hub has done with what a session has sent before."""
    seen = intruder.liveliness().get(f"{PREFIX}/*/alive/*/*", timeout=PATIENCE_S)
    assert [reply for reply in seen if reply.ok is not None]


def asking(number: int, command: int = Command.DO_FLIGHTTERMINATION) -> CommandRequest:
    """Ask for an emergency stop, or something else."""
    return CommandRequest(request_id=number, param1=1.0, param2=0.0, command=command)


def reason_of(answer: Message | bytes) -> int:
    assert isinstance(answer, CommandAck)
    return answer.result_param2


@contextmanager
def unruly(network: Network) -> Iterator[zenoh.Session]:
    """Open a bare session that applies no rules itself."""
    config = configured(network, PATIENCE_S)
    config.insert_json5("access_control", '{"enabled": false}')
    with zenoh.open(config) as session:
        yield session


def forge(session: zenoh.Session, operator: str = "ground/abc") -> int:
    """Send an emergency stop and the operator's wheel as that operator; how many of these."""
    frames = Encoder(255, 190)
    for number in range(EACH):
        frame = frames.encode(asking(number + 1))
        key = f"{PREFIX}/r1/{COMMAND.path}/{operator}"
        replies = session.get(key, payload=frame, encoding=ENCODING, timeout=PATIENCE_S)
        assert list(replies) == []
        session.put(f"{PREFIX}/r1/{TELEOP.path}/{operator}", frame, encoding=ENCODING)
    return 2 * EACH


@contextmanager
def listening(keys: Path) -> Iterator[tuple[Locked, Running]]:
    with Locked(keys, router=True) as crew:
        yield crew, crew.router


def test_refused_connection_is_explained_on_both_sides(tmp_path: Path) -> None:
    """One without TLS does not get as far as the router's log: its door drops it."""
    ring = Keyring(tmp_path / "ring")
    ring.config("router")
    other = Keyring(tmp_path / "other").tls("ground")
    believing = Tls(ca=ring.tls("ground").ca, certificate=other.certificate, key=other.key)
    kept_out = (
        (ring.expired("ground"), "expired at", "certificate expired"),
        (ring.early("ground"), "is not valid before", "certificate not valid yet"),
        (other, "signed by another authority", "it rejects the certificate of this process"),
        (believing, "is not signed by", "its certificate is signed by another authority"),
    )
    with listening(tmp_path / "ring") as (crew, router):
        for tls, told_there, told_here in kept_out:
            with pytest.raises(AccessDeniedError, match=told_there):
                open_bus(dialling(crew.endpoint, tls), Role.GROUND, "r1")
            router.says(told_here, PATIENCE_S)
        with pytest.raises(AccessDeniedError, match="accepts only TLS"):
            open_bus(dialling(crew.endpoint, None), Role.GROUND, "r1")
        router.says("it shows no certificate", PATIENCE_S)  # an attempt without a certificate
        assert "connection refused: it shows no certificate" in router.said


def test_a_robots_key_where_the_router_is_dialled_gets_no_robot_and_no_health(keys: Path) -> None:
    """Real processes on both sides: the robot logs why it does not start."""
    with Locked(keys) as crew:
        crew.start("router", "--listen", crew.endpoint, role="robot-r2").says("router at")
        robot = crew.dialling("robot", "--start", "0.6", "2", "0")
        assert robot.ends() != 0
        assert "shows the certificate of 'robot-r2', and robot-r1 dials only a router" in robot.said
        code, said = crew.verb("ground", "doctor")
        assert code == 1
        assert "E the process at " in said
        assert "shows the certificate of 'robot-r2'" in said


def test_up_runs_behind_locks(keys: Path) -> None:
    """All processes run in simulated time, the recorder included."""
    with Crew() as crew:
        record = str(keys.parent / "record")
        words = ("--headless", "--world", "open", "--speed", "max", "--locks", str(keys))
        up = crew.start("up", *words, "--record", record)
        assert up.ends(60.0) == 0, up.said
        (log,) = Path(record).glob("*.tlog")
        assert log.stat().st_size > 10_000


def test_listener_with_expired_certificate_exits_with_a_reason(tmp_path: Path) -> None:
    ring = Keyring(tmp_path / "ring")
    ring.config("router", ring.expired("router"))
    with Locked(tmp_path / "ring") as crew:
        router = crew.listening("router")
        assert router.ends() == 2
        assert "expired at" in router.said
        assert "all others would reject it" in router.said


LOGGED = """
import sys, zenoh
from protocol.bus.audit import ZenohLog
print("before")
with ZenohLog("debug") as log:
    print("python's own goes on")
    quiet = "{mode: 'peer', scouting: {multicast: {enabled: false}}}"
    with zenoh.open(zenoh.Config.from_json5(quiet)):
        pass
    sys.stderr.write(str(len(b"".join(log.take())) > 100))
with zenoh.open(zenoh.Config.from_json5(quiet)):
    pass  # which Zenoh logs, too, though nobody listens any more
print("after")
"""


def test_zenohs_log_is_caught_and_standard_output_stays_pythons() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LOGGED],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=True,
        env={"PYTHONPATH": ":".join(sys.path), "RUST_LOG": "off"},
    )
    assert done.stdout == "before\npython's own goes on\nafter\n"
    assert done.stderr == "True"


BY_DATAGRAM = "by datagram"


@pytest.fixture(scope="module")
def stop_keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ways") / "keys"
    make(folder, ["r1", "r2"], {}, NOW - DAY, NOW + DAY, ["ada", "bob"])
    return folder


@pytest.fixture
def crew(stop_keys: Path) -> Iterator[Locked]:
    with Locked(stop_keys, lockstep=True) as crew:
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
    crew: Locked, stop_keys: Path, tmp_path: Path
) -> None:
    for role in ("viewer", "plant", "recorder"):
        stranger = crew.execute(
            *command(("estop", *cut_off(crew, stop_keys, role, tmp_path)), os.getpid())
        )
        assert stranger.ends() != 0
        assert "not that of an operator" in stranger.said
    ended = crew.execute(
        *command(("estop", *cut_off(crew, stop_keys, "ground-ada", tmp_path)), os.getpid())
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


def test_garbage_connections_do_not_keep_an_operator_out(crew: Locked, stop_keys: Path) -> None:
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
