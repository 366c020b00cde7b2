"""Noise on every topic and every service, while a robot drives: counted, shown, and ignored."""

import random
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

import pytest

from protocol.bus.network import Network
from protocol.bus.session import open_session
from protocol.topics import ENCODING, SERVICES, STOP, STOP_SERVICE, TOPICS, Topic
from protocol.wire.codec import Encoder
from protocol.wire.enums import GoalState
from protocol.wire.messages import CommandRequest, WheelTicks
from tests.support.stack.processes import Crew, Witness
from tests.support.until import PATIENCE_S, until

pytestmark = pytest.mark.stack

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
def stranger(endpoint: str) -> Iterator[Any]:
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
        with Witness(crew.endpoint, strict=False) as witness, stranger(crew.endpoint) as session:
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
        with Witness(crew.endpoint, strict=False) as witness, stranger(crew.endpoint) as session:
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
