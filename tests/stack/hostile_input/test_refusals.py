"""Invalid endpoints, names, versions and numbers are named by the process that rejects them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from protocol.bus.network import Network
from protocol.bus.session import open_session
from protocol.topics import COMMAND, HEARTBEAT, PARAMETER, SONAR, Role
from protocol.wire.codec import Encoder
from protocol.wire.enums import AckResult
from protocol.wire.messages import CommandAck, ParamSet, SonarScan
from protocol.wire.reasons import Reason
from tests.support.bus.robots import BEAT
from tests.support.stack.processes import Crew, Running, Witness
from tests.support.until import PATIENCE_S, until

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
