"""Attackers on a robot's bus, each a process: a flood of frames, of questions, of connections.

`python -m benchmarks.flood_attack KIND ENDPOINT RATE` says `ready`, begins when it is given a line,
and goes on until it is ended; then it says how much it has sent.
"""

import json
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from itertools import cycle
from random import Random
from typing import Any, Final, NamedTuple

import zenoh
from zenoh.handlers import Callback

from protocol.bus.session import open_session
from protocol.clock import WallClock
from protocol.codec import Encoder, decode
from protocol.enums import AUTOPILOT_INVALID, TYPE_GCS, AckResult, Command, LeaseAction, Mode
from protocol.message import Message
from protocol.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    Heartbeat,
    LeaseRequest,
    ParamSet,
    SonarScan,
    Teleop,
    WheelTicks,
)
from protocol.network import Network
from protocol.reasons import Reason
from protocol.topics import (
    COMMAND,
    ENCODING,
    LEASE_SERVICE,
    OPERATOR,
    PARAMETER,
    PARAMETERS,
    SONAR,
    TELEOP,
    WHEELS,
    Service,
    Topic,
)

ROBOT: Final = "r1"
TURN_S: Final = 0.005
STRANGERS: Final = ("", "0123456789abcdef", "ffffffffffffffffffffffffffffffff", "not an identity")
OVERSIZED: Final = 2_000_000
ACTED: Final = "acted upon"
REFUSED: Final = Reason.LEASE_HELD.name.lower()
CONNECTIONS: Final = 200
SCAN: Final = SonarScan(
    time_ns=1_000_000, seq=1, range_mm=(50,) * 8, ping_age_us=(9,) * 8, valid=255, echo=255
)
TICKS: Final = WheelTicks(time_ns=1_000_000, seq=1, left=7, right=-9, bumper=7, expired=0)
STEER: Final = Teleop(time_ns=1, seq=1, speed_mm_s=300, yaw_rate_mrad_s=0, ttl_ms=500)
BEAT: Final = Heartbeat(
    type=TYPE_GCS, autopilot=AUTOPILOT_INVALID, base_mode=0, custom_mode=0, system_status=4
)
SAID: Final[tuple[tuple[Topic[Any], Message], ...]] = (
    (SONAR, SCAN),
    (WHEELS, TICKS),
    (TELEOP, STEER),
    (OPERATOR, BEAT),
)
COMMANDS: Final = (
    Command.COMPONENT_ARM_DISARM,
    Command.DO_SET_MODE,
    Command.DO_PAUSE_CONTINUE,
    Command.NAV_RETURN_TO_LAUNCH,
    Command.MISSION_START,
    Command.SIDESTEP_SET_NAVIGATOR,
    Command.SIDESTEP_ABORT_GOAL,
    Command.SIDESTEP_CLEAR_EMERGENCY_STOP,
)


class Shot(NamedTuple):
    """Something to put or to ask: where, what, said to be encoded how, and by whom."""

    path: str
    payload: bytes
    encoding: str
    sender: str


def frames() -> list[Shot]:
    """What was sent before, once more; what is broken; what is no frame; what is far too large."""
    random, found = Random(1), []
    for topic, message in SAID:
        frame = Encoder(1, 25).encode(message)
        bad = frame[:-1] + bytes([frame[-1] ^ 1])
        others = (frame[:-3], frame + b"\0", random.randbytes(60), b"", b"\xfd" * 300)
        for sender in STRANGERS:
            found += [Shot(topic.path, one, ENCODING, sender) for one in (frame, bad, *others)]
            found.append(Shot(topic.path, frame, "application/mavlink2;sidestep@2", sender))
    return found


def questions() -> list[Shot]:
    """Commands of somebody who may not command, and what is no question."""
    random, encoder, found = Random(2), Encoder(255, 190), []
    requests: list[tuple[Service, Message]] = [
        (COMMAND, CommandRequest(request_id=n, param1=1.0, param2=4.0, command=command))
        for n, command in enumerate(COMMANDS, start=10)
    ]
    requests += [
        (COMMAND, goal(99)),
        (PARAMETER, ParamSet(param_id="v_max_m_s", param_value=0.01, param_type=9)),
        (LEASE_SERVICE, LeaseRequest(request_id=98, action=LeaseAction.TAKE, name="mallory")),
        (LEASE_SERVICE, LeaseRequest(request_id=97, action=LeaseAction.RELEASE, name="mallory")),
    ]
    for service, message in requests:
        frame = encoder.encode(message)
        for sender in STRANGERS:
            found.append(Shot(service.path, frame, ENCODING, sender))
            found.append(Shot(service.path, frame[:-1], ENCODING, sender))
            found.append(Shot(service.path, random.randbytes(40), "", sender))
    found.append(Shot(PARAMETERS.path, b"", "", ""))
    found.append(Shot(COMMAND.path, b"\xfd" * OVERSIZED, ENCODING, ""))
    return found


def goal(request_id: int) -> GoalRequest:
    return GoalRequest(
        request_id=request_id,
        x_mm=0,
        y_mm=0,
        heading_urad=0,
        position_tolerance_mm=50,
        heading_tolerance_urad=9999,
        heading_free=1,
        mode=Mode.AUTO,
    )


class Attacker:
    """One session; `answers` counts what came back."""

    def __init__(self, network: Network) -> None:
        self.session = open_session(network)
        self.answers = Counter[str]()
        self._key = f"{network.prefix}/{ROBOT}"

    def put(self, shot: Shot) -> None:
        self.session.put(
            f"{self._key}/{shot.path}",
            shot.payload,
            encoding=shot.encoding or None,
            attachment=shot.sender or None,
            congestion_control=zenoh.CongestionControl.DROP,
        )

    def ask(self, shot: Shot) -> None:
        self.session.get(
            f"{self._key}/{shot.path}",
            Callback(self._count, indirect=False),
            payload=shot.payload,
            encoding=shot.encoding or None,
            attachment=shot.sender or None,
            timeout=1.0,
        )

    def _count(self, reply: zenoh.Reply) -> None:
        self.answers["unanswered" if reply.ok is None else in_a_word(reply.ok)] += 1


def in_a_word(sample: zenoh.Sample) -> str:
    """What came of a question: acted upon, or why not."""
    if str(sample.encoding) != ENCODING:
        return "looked"
    answer = decode(sample.payload.to_bytes()).message
    if not isinstance(answer, CommandAck) or answer.result == AckResult.ACCEPTED:
        return ACTED
    return Reason(answer.result_param2).name.lower()


def shoot(one: Callable[[Shot], None], shots: Sequence[Shot], rate_hz: float) -> int:
    """In small volleys, so that the rate is kept; how many, when it is told to end."""
    clock, supply, fired = WallClock(), cycle(shots), 0
    begun_ns = clock.now_ns()
    for turn in turns():
        clock.sleep_until(begun_ns + round(turn * TURN_S * 1e9))
        due = round((clock.now_ns() - begun_ns) / 1e9 * rate_hz)
        for _ in range(min(due - fired, round(rate_hz * 0.1))):
            one(next(supply))
        fired = due
    return fired


def turns() -> Iterator[int]:
    """Until SIGTERM."""
    told: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: told.append(number))
    turn = 0
    while not told:
        yield turn
        turn += 1


def main(arguments: Sequence[str]) -> None:
    kind, endpoint, rate_hz = arguments[0], arguments[1], float(arguments[2])
    network = Network(mode="client", connect=(endpoint,))
    with ExitStack() as scope:
        attackers = [Attacker(network) for _ in range(CONNECTIONS if kind == "connections" else 1)]
        for attacker in attackers:
            scope.callback(attacker.session.close)
        print("ready", file=sys.stderr, flush=True)
        sys.stdin.readline()
        first = attackers[0]
        if kind == "questions":
            fired = shoot(first.ask, questions(), rate_hz)
        else:
            fired = shoot(first.put, frames(), rate_hz)
        print(json.dumps({"kind": kind, "sent": fired, **first.answers}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
