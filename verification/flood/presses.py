"""What the attackers of `bench flood` send: replayed, broken, forged and oversized samples."""

from collections.abc import Iterable
from random import Random
from time import monotonic_ns
from typing import Any, Final, NamedTuple

from protocol.bus.robot_clock import time_bytes
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
from protocol.wire.enums import AUTOPILOT_INVALID, TYPE_GCS, Command, LeaseAction, Mode
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandRequest,
    GoalRequest,
    Heartbeat,
    LeaseRequest,
    ParamSet,
    SonarScan,
    Teleop,
    WheelCommand,
    WheelTicks,
)

OVERSIZED: Final = 2_000_000
GOOD_FOR_NS: Final = 1_000_000_000
UINT32: Final = 2**32 - 1
FULL_MRAD_S: Final = 9000
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
    """Something to put or to ask; `path` is the key below the robot's.

    `stamped`: with the robot's time, of now for a sample, of a second from now for a request.
    """

    path: str
    payload: bytes
    encoding: str = ENCODING
    stamped: bool = False

    def attachment(self, ahead_ns: int = 0) -> bytes | None:
        """Return the time of sending; one machine has one monotonic clock."""
        return time_bytes(monotonic_ns() + ahead_ns) if self.stamped else None


def named(topic: Topic[Any] | Service, operator: str) -> str:
    """Return the path on which an operator says or asks something."""
    return f"{topic.path}/{operator}" if topic.of_operators and operator else topic.path


def names_of(operator: str) -> tuple[str, ...]:
    """Return what an attacker calls itself: nothing, itself, or what is no operator."""
    return "", operator, "eve/0123456789abcdef", "Not an/identity/at all"


def frames(operator: str) -> list[Shot]:
    """What was sent before, once more; what is broken; what is no frame; what is far too large."""
    random, found = Random(1), []
    for topic, message in SAID:
        frame = Encoder(1, 25).encode(message)
        bad = frame[:-1] + bytes([frame[-1] ^ 1])
        others = (frame[:-3], frame + b"\0", random.randbytes(60), b"", b"\xfd" * 300)
        for path in dict.fromkeys(named(topic, name) for name in names_of(operator)):
            found += [Shot(path, one, stamped=True) for one in (frame, bad, *others)]
            found.append(Shot(path, frame, "application/mavlink2;sidestep@1"))
    return found


def questions(operator: str) -> list[Shot]:
    """Commands of somebody who may not command, and what is no question."""
    random, found = Random(2), []
    encoder = Encoder(255, 190)
    for service, message in forbidden():
        frame = encoder.encode(message)
        for name in names_of(operator):
            path = named(service, name)
            found.append(Shot(path, frame, stamped=True))
            found.append(Shot(path, frame))
            found.append(Shot(path, frame[:-1], stamped=True))
            found.append(Shot(path, random.randbytes(40), ""))
    found.append(Shot(PARAMETERS.path, b"", ""))
    found.append(Shot(named(COMMAND, operator), b"\xfd" * OVERSIZED))
    return found


def forbidden() -> list[tuple[Service, Message]]:
    """Requests that only the holder of the lease may make."""
    found: list[tuple[Service, Message]] = [(COMMAND, order(n, n)) for n in COMMANDS]
    return [
        *found,
        (COMMAND, goal(99)),
        (PARAMETER, ParamSet(param_id="v_max_m_s", param_value=0.01, param_type=9)),
        (LEASE_SERVICE, LeaseRequest(request_id=98, action=LeaseAction.TAKE, name="mallory")),
        (LEASE_SERVICE, LeaseRequest(request_id=97, action=LeaseAction.RELEASE, name="mallory")),
    ]


def order(request_id: int, command: int, param1: float = 1.0) -> CommandRequest:
    return CommandRequest(request_id=request_id, param1=param1, param2=4.0, command=command)


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


def wheels(answered: int) -> Iterable[WheelCommand]:
    """Full speed, said to answer senses of the future, of the past, and the newest ones.

    `answered`: the newest senses there are.
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
