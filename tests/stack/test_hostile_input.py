"""Invalid settings, worlds and noise: named by the process that rejects them."""

import random
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import zenoh

from checks.harness.crew import Crew, Witness
from checks.harness.processes import Running
from checks.harness.until import PATIENCE_S, until
from ground.cli.main import main
from ground.cli.run import up
from ground.launch.child_processes import Children
from protocol.bus.network import Network
from protocol.bus.session import open_session
from protocol.topics import (
    COMMAND,
    ENCODING,
    HEARTBEAT,
    PARAMETER,
    SERVICES,
    SONAR,
    STOP,
    STOP_SERVICE,
    TOPICS,
    Role,
    Topic,
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import AckResult, GoalState
from protocol.wire.messages import CommandAck, CommandRequest, ParamSet, SonarScan, WheelTicks
from protocol.wire.reasons import Reason
from tests.support.plant import GOOD as WORLD_TEXTS_GOOD
from tests.support.plant import goal, more
from tests.support.played_robot import BEAT

pytestmark = pytest.mark.stack

NEWER = "application/mavlink2;sidestep@9"
DIFFER = "has dialect sidestep@9, not sidestep@2"
SCAN = SonarScan(time_ns=0, seq=0, range_mm=(9,) * 8, ping_age_us=(0,) * 8, valid=255, echo=0)


def refused(running: Running, code: int, *words: str) -> None:
    assert running.ends() == code, running.said
    assert "Traceback" not in running.said
    assert "internal error" not in running.said
    for word in words:
        assert word in running.said


def test_a_hub_refuses_another_hub_and_another_plant() -> None:
    with Crew() as crew:
        crew.robot()
        crew.plant()
        others = [crew.listening("robot"), crew.listening("router")]
        refused(crew.dialling("plant"), 2, "there is a plant for r1 already")
        for other in others:
            refused(other, 2, crew.endpoint, "is in use")


def test_by_a_router_a_second_robot_and_a_second_plant_of_one_name_are_refused() -> None:
    with Crew(router=True) as crew:
        robot, plant = crew.robot(), crew.plant()
        second_robot, second_plant = crew.dialling("robot"), crew.dialling("plant")
        refused(second_robot, 2, "there is a robot for r1 already")
        refused(second_plant, 2, "there is a plant for r1 already")
        with Witness(crew.endpoint) as witness:
            witness.ready()
        assert robot.process.poll() is None
        assert plant.process.poll() is None


def test_unanswered_endpoint_is_named(tmp_path: Path) -> None:
    hasty = tmp_path / "hasty.toml"
    hasty.write_text("[network]\nconnect_timeout_s = 0.5\n")
    unknown = "tcp/no-such-host.invalid:7447"
    with Crew() as crew:
        stray = crew.start("watch", "--connect", unknown)
        verbs = {name: crew.dialling(name) for name in ("watch", "ground", "hold", "doctor")}
        verbs["goto"] = crew.dialling("goto", "1", "1")
        verbs["param"] = crew.dialling("param", "list")
        plant = crew.dialling("plant", "--config", str(hasty))
        for running in verbs.values():
            refused(running, 1, crew.endpoint, "no process answers")
        refused(plant, 2, crew.endpoint, "no process answers")
        refused(stray, 1, unknown, "does not resolve")
        refused(crew.start("robot", "--listen", unknown), 2, unknown)


def test_an_endpoint_that_is_none_is_named_with_how_to_write_it() -> None:
    with Crew() as crew:
        started = {
            "nonsense": crew.start("robot", "--listen", "nonsense"),
            "tcp/127.0.0.1": crew.start("plant", "--connect", "tcp/127.0.0.1"),
            "tcp/127.0.0.1:x": crew.start("watch", "--connect", "tcp/127.0.0.1:x"),
            "smtp/a:1": crew.start("router", "--listen", "smtp/a:1"),
        }
        for endpoint, running in started.items():
            refused(running, 2, f"endpoint {endpoint!r}", "tcp/127.0.0.1:7447")


@pytest.mark.parametrize(
    ("words", "code", "reason"),
    [
        (("goto", "nan", "1"), 2, "finite"),
        (("goto", "1", "inf"), 2, "finite"),
        (("goto", "1e9", "1"), 2, "out of range"),
        (("goto", "20000", "1", "--anyway"), 1, "farther than the robot accepts"),
        (("param", "set", "d_obs_m", "nan"), 2, "finite"),
        (("param", "set", "d_obs_m", "-1"), 1, "out of its range; allowed: 0.05 to 3 m"),
        (("param", "set", "d_obs", "0.3"), 1, "no such parameter; did you mean d_obs_m?"),
        (("param", "set", "d_obs_m", "1e30"), 1, "out of its range"),
    ],
)
def test_a_number_that_cannot_be_is_refused_with_a_reason(
    stack: Crew, words: tuple[str, ...], code: int, reason: str
) -> None:
    refused(stack.dialling(*words), code, reason)


@pytest.fixture(scope="module")
def stack() -> Iterator[Crew]:
    with Crew() as crew:
        crew.plant(waits=False)
        crew.robot()
        with Witness(crew.endpoint) as witness:
            witness.ready()
        yield crew


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0, 1e30])
def test_the_robot_itself_refuses_what_another_client_lets_through(
    stack: Crew, value: float
) -> None:
    with Witness(stack.endpoint) as witness:
        request = ParamSet(param_id="d_obs_m", param_value=value, param_type=9)
        answer = witness.bus.ask(PARAMETER, request, PATIENCE_S)
    assert isinstance(answer, CommandAck)
    assert (answer.result, answer.result_param2) == (
        AckResult.DENIED,
        Reason.PARAMETER_OUT_OF_RANGE,
    )


@contextmanager
def stranger(network: Network) -> Iterator[Any]:
    """Open a session that may publish anything."""
    session: Any = open_session(network)
    try:
        yield session
    finally:
        session.close()


def test_a_plant_of_another_version_is_named_by_robot_and_doctor() -> None:
    with Crew() as crew:
        crew.robot()
        client = Network(mode="client", connect=(crew.endpoint,))
        with Witness(crew.endpoint) as witness, stranger(client) as session:
            frame = Encoder(1, 25).encode(SCAN)

            def counted() -> bool:
                session.put(SONAR.key("r1"), frame, encoding=NEWER)
                return witness.report is not None and witness.report.rejected > 3

            until(counted, what="rejections in the robot's report")
            doctor = crew.dialling("doctor")
            until(lambda: counted() and doctor.process.poll() is not None, what="the doctor")
        refused(doctor, 1, DIFFER, "sense/sonar", "same version", "the robot rejected")


def test_a_robot_of_another_version_is_named_by_the_verbs() -> None:
    with Crew() as crew:
        listening = Network(mode="peer", listen=(crew.endpoint,))
        with stranger(listening) as session:
            speaks(session)
            heart = session.declare_publisher(HEARTBEAT.key("r1"))
            verbs = [
                crew.dialling("hold"),
                crew.dialling("estop"),
                crew.dialling("doctor"),
            ]

            def ended() -> bool:
                heart.put(Encoder(1, 1).encode(BEAT), encoding=NEWER)
                return all(running.process.poll() is not None for running in verbs)

            until(ended, what="the verbs to end")
        for running in verbs:
            refused(running, 1, DIFFER)
            assert "hangs" not in running.said


def speaks(session: Any) -> None:
    """Serves commands and is there, as a robot of the next version would."""
    answer = Encoder(1, 1).encode(CommandAck(command=0, result=0))
    key = COMMAND.key("r1")

    def take(query: zenoh.Query) -> None:
        with query:
            query.reply(key, answer, encoding=NEWER)

    session.declare_queryable(key, take)
    session.liveliness().declare_token(f"sidestep/r1/alive/{Role.ROBOT.value}/{session.zid()}")


class Spoilt(NamedTuple):
    """A text, and the words of its error message: line and key, reason, fix."""

    text: str
    words: tuple[str, ...]


UNKNOWN = Spoilt(more("colour = 1\n"), (":20: obstacle#4.colour", "unknown key", "fix: "))
OUTSIDE = Spoilt(
    goal("{ x_m = 9.0, y_m = 2.0, heading_deg = 0.0 }"), (":4: goal", "outside", "fix: ")
)


@pytest.mark.parametrize("spoilt", [UNKNOWN, OUTSIDE], ids=["structure", "geometry"])
def test_it_is_refused_with_file_key_reason_and_fix(spoilt: Spoilt, tmp_path: Path) -> None:
    """All kinds of mistakes are in tests/unit/plant/test_world_files.py."""
    file, log = tmp_path / "spoilt.toml", tmp_path / "log"
    file.write_text(spoilt.text, encoding="utf-8")
    with Crew() as crew, socket.create_server(("127.0.0.1", 0)) as hub:
        hub.setblocking(False)
        endpoint = f"tcp/127.0.0.1:{hub.getsockname()[1]}"
        refused = [
            crew.start("up", "--world", str(file), "--record", str(log)),
            crew.start("plant", "--world", str(file), "--connect", endpoint),
            crew.start("trial", "--world", str(file), "--navigator", "bug", "--json"),
        ]
        for running in refused:
            assert running.ends() == 2, running.said
            assert "Traceback" not in running.said
            assert f"{file}:" in running.said
            for word in spoilt.words:
                assert word in running.said
        with pytest.raises(BlockingIOError):
            hub.accept()  # the plant has not even dialled
    assert not log.exists()


def test_the_good_world_they_were_made_of_is_taken(tmp_path: Path) -> None:
    file = tmp_path / "good.toml"
    file.write_text(WORLD_TEXTS_GOOD, encoding="utf-8")
    with Crew() as crew:
        shown = crew.start("worlds", "check", str(file))
        assert shown.ends() == 0, shown.said


def test_up_starts_no_process_for_a_bad_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    started: list[str] = []
    monkeypatch.setattr(Children, "start", lambda _, role, words: started.append(role))
    monkeypatch.setattr(up, "free_endpoint", lambda: started.append("endpoint"))
    file = tmp_path / "spoilt.toml"
    file.write_text(OUTSIDE.text, encoding="utf-8")
    assert main(["up", "--world", str(file)]) == 2
    assert started == []
    assert "goal" in capsys.readouterr().err


GOOD = Encoder(1, 25).encode(WheelTicks(time_ns=1, seq=1, left=5, right=5, bumper=0, expired=0))
WRONG_TEXT = Encoder(255, 190).encode(
    CommandRequest(request_id=1, command=65_000, param1=float("nan"), param2=float("inf"))
)
CHANCE = random.Random(7)
NOISE = (
    b"",
    b"\x00",
    GOOD[:-1],
    GOOD[:9],
    GOOD[:-1] + bytes([GOOD[-1] ^ 1]),
    b"\xfd" + b"\xff" * 300,
    "sidestep ".encode("utf-16"),
    b'{"name": "\xff\xfe"}',
    WRONG_TEXT,
    CHANCE.randbytes(280),
    CHANCE.randbytes(1 << 20),
)
KINDS = (ENCODING, "application/json", "")

OTHER_TOPICS = [topic for topic in TOPICS if topic is not STOP]
OTHER_SERVICES = [service for service in SERVICES if service is not STOP_SERVICE]
"""Whatever arrives as an emergency stop is one, noise included."""


@contextmanager
def noisy_stranger(endpoint: str) -> Iterator[Any]:
    session: Any = open_session(Network(mode="client", connect=(endpoint,)))
    try:
        yield session
    finally:
        session.close()


def key_of(topic: Topic[Any]) -> str:
    """Return a key on which the topic is received: an operator's ends in its identity."""
    return topic.key("r1") + ("/open/abc" if topic.of_operators else "")


def babble(session: Any, noises: Sequence[bytes] = NOISE) -> int:
    """Publish every noise in every encoding on every topic; return the number of messages."""
    for topic in OTHER_TOPICS:
        for noise in noises:
            for kind in KINDS:
                session.put(key_of(topic), noise, encoding=kind)
    return len(OTHER_TOPICS) * len(noises) * len(KINDS)


def pester(session: Any) -> None:
    """Send each noise to each service until it replies.

    A client that sends megabytes faster than its peer reads closes its own link (wait_before_close,
    protocol/bus/session.py); until it is connected again its questions reach nobody.
    """
    for service in OTHER_SERVICES:
        for number, noise in enumerate(NOISE):
            ask = partial(is_answered, session, service.key("r1"), noise)
            until(ask, what=f"an answer of {service.path} to noise {number}")


def is_answered(session: Any, key: str, noise: bytes) -> bool:
    replies = session.get(key, payload=noise, encoding=ENCODING, timeout=PATIENCE_S)
    return any(reply.ok is not None for reply in replies)


def test_the_robot_reaches_its_goal_all_the_same() -> None:
    with Crew(lockstep=True) as crew:
        plant, robot = crew.plant(waits=False), crew.robot()
        with (
            Witness(crew.endpoint, strict=False) as witness,
            noisy_stranger(crew.endpoint) as session,
        ):
            witness.ready()
            watch, goto = crew.dialling("watch"), crew.dialling("goto", "1.4", "2")
            witness.driving()
            babble(session)
            pester(session)
            assert goto.ends() == 0, goto.said
            assert witness.status.goal == GoalState.REACHED
            assert abs(witness.truth.x_m - 1.4) < 0.1
            until(lambda: witness.report is not None and witness.report.rejected > 50)
        code, said = crew.run("doctor")
        assert code == 0, said
        assert "the robot rejected" in said
        for running in (robot, plant, watch):
            assert running.process.poll() is None, running.said
            assert "Traceback" not in running.said
        assert "rejected on" in plant.said


def test_the_doctor_counts_it_by_topic() -> None:
    with Crew() as crew:
        crew.plant(waits=False)
        crew.robot()
        with (
            Witness(crew.endpoint, strict=False) as witness,
            noisy_stranger(crew.endpoint) as session,
        ):
            witness.ready()
            until(lambda: all_counted(crew, session), what="every topic in one diagnosis")


def all_counted(crew: Crew, session: Any) -> bool:
    """Return whether the doctor names every topic while noise arrives."""
    doctor = crew.dialling("doctor", "--timeout", "1.0")
    while doctor.process.poll() is None:
        babble(session, NOISE[:-1])
        with suppress(subprocess.TimeoutExpired):
            doctor.process.wait(0.1)  # it has a second to count them
    return all(f"unreadable messages on {topic.path}" in doctor.said for topic in OTHER_TOPICS)
