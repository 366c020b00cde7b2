"""The payloads of `bench flood`: replayed, broken, forged and oversized samples and queries."""

from collections.abc import Iterable
from random import Random
from time import monotonic_ns
from typing import Any, Final, NamedTuple

from checks.harness.bus_calls import OPERATOR_BEAT, auto_goal_request
from protocol.bus.robot_clock import time_bytes
from protocol.outcome import wire_goal
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
from protocol.wire.codec import Encoder
from protocol.wire.enums import Command, LeaseAction, Mode
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    ParamSet,
    SonarScan,
    Teleop,
    WheelCommand,
    WheelTicks,
)
from runtime.units import UINT32

OVERSIZED: Final = 2_000_000
GOOD_FOR_NS: Final = 1_000_000_000

FULL_MRAD_S: Final = 9000
SCAN: Final = SonarScan(
    time_ns=1_000_000, seq=1, range_mm=(50,) * 8, ping_age_us=(9,) * 8, valid=255, echo=255
)
TICKS: Final = WheelTicks(time_ns=1_000_000, seq=1, left=7, right=-9, bumper=7, expired=0)
STEER: Final = Teleop(time_ns=1, seq=1, speed_mm_s=300, yaw_rate_mrad_s=0, ttl_ms=500)

SAMPLES: Final[tuple[tuple[Topic[Any], Message], ...]] = (
    (SONAR, SCAN),
    (WHEELS, TICKS),
    (TELEOP, STEER),
    (OPERATOR, OPERATOR_BEAT),
)
COMMANDS: Final = (  # that need the lease; whoever may command may also abort
    Command.COMPONENT_ARM_DISARM,
    Command.DO_SET_MODE,
    Command.DO_PAUSE_CONTINUE,
    Command.NAV_RETURN_TO_LAUNCH,
    Command.MISSION_START,
    Command.SIDESTEP_SET_NAVIGATOR,
    Command.SIDESTEP_CLEAR_EMERGENCY_STOP,
)


class Payload(NamedTuple):
    """A sample to publish or a query to send; `path` is the key below the robot's.

    `stamped`: with the robot's time, of now for a sample, of a second from now for a request.
    """

    path: str
    content: bytes
    encoding: str = ENCODING
    stamped: bool = False

    def attachment(self, ahead_ns: int = 0) -> bytes | None:
        """Return the time of sending, if stamped; one machine has one monotonic clock."""
        return time_bytes(monotonic_ns() + ahead_ns) if self.stamped else None


def named(topic: Topic[Any] | Service, operator: str) -> str:
    """Return the path on which an operator publishes or asks."""
    return f"{topic.path}/{operator}" if topic.of_operators and operator else topic.path


def names_of(operator: str) -> tuple[str, ...]:
    """Return the operator names of an attacker: none, its own, a forged and a malformed one."""
    return "", operator, "eve/0123456789abcdef", "Not an/identity/at all"


def frames(operator: str) -> list[Payload]:
    """Return frames that are replayed, corrupted, cut, random or of another protocol version."""
    random, found = Random(1), []
    for topic, message in SAMPLES:
        frame = Encoder(1, 25).encode(message)
        bad = frame[:-1] + bytes([frame[-1] ^ 1])
        others = (frame[:-3], frame + b"\0", random.randbytes(60), b"", b"\xfd" * 300)
        for path in dict.fromkeys(named(topic, name) for name in names_of(operator)):
            found += [Payload(path, one, stamped=True) for one in (frame, bad, *others)]
            found.append(Payload(path, frame, "application/mavlink2;sidestep@1"))
    return found


def questions(operator: str) -> list[Payload]:
    """Return commands that need the lease, malformed queries and an oversized one."""
    random, found = Random(2), []
    encoder = Encoder(255, 190)
    for service, message in forbidden():
        frame = encoder.encode(message)
        for name in names_of(operator):
            path = named(service, name)
            found.append(Payload(path, frame, stamped=True))
            found.append(Payload(path, frame))
            found.append(Payload(path, frame[:-1], stamped=True))
            found.append(Payload(path, random.randbytes(40), ""))
    found.append(Payload(PARAMETERS.path, b"", ""))
    found.append(Payload(named(COMMAND, operator), b"\xfd" * OVERSIZED))
    return found


def forbidden() -> list[tuple[Service, Message]]:
    """Return requests that only the holder of the lease may send."""
    found: list[tuple[Service, Message]] = [(COMMAND, forged_command(n, n)) for n in COMMANDS]
    return [
        *found,
        (COMMAND, forged_goal(99)),
        (PARAMETER, ParamSet(param_id="v_max_m_s", param_value=0.01, param_type=9)),
        (LEASE_SERVICE, LeaseRequest(request_id=98, action=LeaseAction.TAKE, name="mallory")),
        (LEASE_SERVICE, LeaseRequest(request_id=97, action=LeaseAction.RELEASE, name="mallory")),
    ]


def forged_command(request_id: int, command: int, param1: float = 1.0) -> CommandRequest:
    """Return a command of an attacker."""
    return CommandRequest(request_id=request_id, param1=param1, param2=Mode.GUIDED, command=command)


def forged_goal(request_id: int) -> GoalRequest:
    """Return a goal of an attacker."""
    return auto_goal_request(request_id, wire_goal(0.0, 0.0, None, 0.05, 0.009999))


def wheels(answered: int) -> Iterable[WheelCommand]:
    """Yield wheel commands at full speed in answer to future, newest and past senses.

    `answered` is the newest sequence number of the senses.
    """
    for sense_seq in (UINT32, UINT32 - 1, answered + 100, answered + 1, answered, 0):
        for ttl_ms in (65_535, 150):
            for number in (UINT32, 0):
                yield WheelCommand(
                    time_ns=monotonic_ns(),
                    seq=number,
                    epoch=number,
                    sense_seq=sense_seq & UINT32,
                    left_mrad_s=FULL_MRAD_S,
                    right_mrad_s=FULL_MRAD_S,
                    ttl_ms=ttl_ms,
                )
