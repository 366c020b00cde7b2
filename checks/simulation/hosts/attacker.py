"""A hostile process on the bus that sends well-formed frames and requests.

It may publish on any key, as on an open bus. Under its own name it is an operator like any other,
as with its own certificate.
"""

from collections import deque
from collections.abc import Callable
from random import Random
from typing import Any, Final

from checks.simulation.hosts.bus import SimulatedHub, SimulatedSample, path_of
from checks.simulation.hosts.virtual_time import Argument, Host, Scheduler
from checks.simulation.invariants.limits import PERIOD_NS
from protocol.bus.robot_clock import time_bytes
from protocol.topics import (
    COMMAND,
    DRIVE,
    ENCODING,
    LEASE_SERVICE,
    OPERATOR,
    SERVICES,
    SONAR,
    STOP,
    STOP_SERVICE,
    TELEOP,
    TOPICS,
    WHEELS,
    Role,
    sender_of,
)
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import Command
from protocol.wire.message import LAYOUT, Field, Message
from protocol.wire.messages import CommandRequest, Heartbeat, LeaseRequest, Teleop, WheelCommand
from robot.commands import kind_of
from runtime.units import NS_PER_MS

ROBOT: Final = "sidestep/r1/"
OWN_NAME: Final = f"open/{0xBAD:032x}"
KEPT: Final = 300
MAX_ID: Final = (1 << 64) - 1
SOON_NS: Final = 500 * NS_PER_MS
STRANGE_TOPICS: Final = tuple(topic for topic in TOPICS if topic.publisher is not Role.ROBOT)
REQUESTS: Final = tuple(
    (service, kind)
    for service in SERVICES
    if service.server is Role.ROBOT
    for kind in service.requests
)
MOVING: Final = tuple(one for one in Command if one != Command.DO_FLIGHTTERMINATION)
HARMLESS: Final = (Command.DO_PAUSE_CONTINUE, Command.COMPONENT_ARM_DISARM, Command.DO_SET_MODE)


class CapturedFrame:
    """A frame or a request of another process, to be replayed."""

    def __init__(self, key: str, frame: bytes, note: bytes | None, *, asked: bool) -> None:
        self.key = key
        self.frame = frame
        self.note = note
        self.asked = asked


class IgnoredReply:
    """A query whose answer is ignored."""

    def answered(self, sample: SimulatedSample) -> None:
        """Ignore the answer."""

    def drop(self) -> None:
        """Ignore the missing answer."""


class SimulatedAttacker:
    """An attacker that knows the robot's clock and the plant's time.

    `false_stamp` is called when it sends a false time stamp under its own name.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        hub: SimulatedHub,
        robot_ns: Callable[[], int],
        plant_ns: Callable[[], int],
        false_stamp: Callable[[], None],
    ) -> None:
        self.host = Host(scheduler, "attacker")
        self._scheduler = scheduler
        self._hub = hub
        self._robot_ns = robot_ns
        self._plant_ns = plant_ns
        self._false_stamp = false_stamp
        self._encoder = Encoder(*sender_of(Role.GROUND, "r1"))
        self._captured: deque[CapturedFrame] = deque(maxlen=KEPT)

    def capture(self, key: str, frame: bytes, note: bytes | None, *, asked: bool) -> None:
        """Keep what operators and the robot send, but no telemetry."""
        if asked or not path_of(key).startswith(("sense/", "tlm/")):
            self._captured.append(CapturedFrame(key, frame, note, asked=asked))

    def attack(
        self, kind: str, count: int, gap_ms: int, salt: int, more: tuple[Argument, ...]
    ) -> None:
        """Repeat an attack `count` times, `gap_ms` apart."""
        random, start_ns = Random(salt), self._scheduler.now_ns
        act = ATTACKS[kind]
        for number in range(count):
            at_ns = start_ns + number * gap_ms * NS_PER_MS + random.randrange(NS_PER_MS)
            self._scheduler.at(at_ns, act, self, random, *more)

    # The attacks.

    def _put(self, path: str, message: Message, note: bytes | None = None) -> None:
        frame = self._encoder.encode(message)
        self._hub.put(self.host, ROBOT + path, frame, ENCODING, note)

    def _ask(self, key: str, frame: bytes, note: bytes | None) -> None:
        waiting: Any = IgnoredReply()
        self._hub.ask(
            SimulatedSample(key, frame, ENCODING, note, self.host), waiting, has_payload=True
        )

    def _good_until(self, random: Random) -> bytes | None:
        """Draw a deadline, mostly a valid one."""
        now_ns = self._robot_ns()
        return random.choice(
            (
                *(time_bytes(now_ns + SOON_NS),) * 6,
                None,
                time_bytes(now_ns - SOON_NS),
                time_bytes((1 << 63) - 1),
                b"\xff",
            )
        )

    def wheels(self, random: Random, offset: int, speed: int, ttl_ms: int) -> None:
        """Forge a wheel command in answer to the plant's tick, an older or a future one."""
        tick = max(0, min(self._plant_ns() // PERIOD_NS + offset, 0xFFFFFFFF))
        fields: dict[str, Any] = {field.name: 0 for field in LAYOUT["WheelCommand"].fields} | {
            "sense_seq": tick,
            "seq": random.choice((0, random.getrandbits(32))),
            "left_mrad_s": speed,
            "right_mrad_s": speed,
            "ttl_ms": ttl_ms,
        }
        if "epoch" in fields:
            fields["epoch"] = random.choice((0, 1, 0xFFFFFFFF))
        self._put(DRIVE.path, WheelCommand(**fields))

    def senses(self, random: Random) -> None:
        """Forge senses with extreme values."""
        topic = random.choice((SONAR, WHEELS))
        self._put(topic.path, extreme(topic.messages[0], random))

    def strange(self, random: Random) -> None:
        """Publish extreme values on a topic that the robot or the plant subscribes to."""
        topic = random.choice(STRANGE_TOPICS)
        message = extreme(random.choice(topic.messages), random)
        if topic.path == DRIVE.path or not topic.of_operators:
            self._put(topic.path, message)
            return
        self._false_stamp()
        stamp_ns = random.choice((self._robot_ns(), 0, -(1 << 63), (1 << 63) - 1))
        self._put(f"{topic.path}/{OWN_NAME}", message, time_bytes(stamp_ns))

    def commands(self, random: Random) -> None:
        """Send heartbeats and teleop under its own name without the lease."""
        note = time_bytes(self._robot_ns())
        beat = Heartbeat(
            type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4, mavlink_version=3
        )
        self._put(f"{OPERATOR.path}/{OWN_NAME}", beat, note)
        teleop = Teleop(
            time_ns=self._robot_ns(),
            seq=random.getrandbits(31),
            speed_mm_s=300,
            yaw_rate_mrad_s=0,
            ttl_ms=random.choice((250, 500, 65_535)),
        )
        self._put(f"{TELEOP.path}/{OWN_NAME}", teleop, note)

    def known_stops(self, random: Random) -> None:
        """Publish the request id of an answered request as a stop."""
        known = [one.frame for one in self._captured if one.asked and COMMAND.path in one.key]
        if known:
            end = random.choice((OWN_NAME, "x"))
            self._hub.put(self.host, f"{ROBOT}{STOP.path}/{end}", known[-1], ENCODING, None)

    def stops(self, random: Random) -> None:
        """Send a stop with its own request id, or an unreadable one."""
        forged = self._encoder.encode(command(Command.DO_FLIGHTTERMINATION, random))
        frame = random.choice((forged, forged, b"", b"\0" * 40))
        way = random.randrange(3)
        if way == 0:
            self._ask(f"{ROBOT}{STOP_SERVICE.path}/{OWN_NAME}", frame, None)
        elif way == 1:
            self._ask(f"{ROBOT}{COMMAND.path}/{OWN_NAME}", forged, self._good_until(random))
        else:
            end = random.choice((OWN_NAME, "x", "open/" + "0" * 40))
            self._hub.put(self.host, f"{ROBOT}{STOP.path}/{end}", frame, ENCODING, None)

    def requests(self, random: Random) -> None:
        """Send a request with extreme values, mostly in time and under its own name."""
        service, kind = random.choice(REQUESTS)
        message = extreme(kind, random)
        if kind is CommandRequest and random.random() < 0.7:
            message = command(random.choice(tuple(Command)), random)
        if kind_of(message).is_emergency_stop:
            return
        end = random.choice((f"/{OWN_NAME}",) * 5 + ("", "/nobody"))
        frame = self._encoder.encode(message)
        self._ask(f"{ROBOT}{service.path}{end}", frame, self._good_until(random))

    def orders(self, random: Random) -> None:
        """Send every command that could move the robot, as an operator without the lease."""
        request = command(random.choice(MOVING), random)
        note = time_bytes(self._robot_ns() + SOON_NS)
        self._ask(f"{ROBOT}{COMMAND.path}/{OWN_NAME}", self._encoder.encode(request), note)

    def seizes(self, random: Random) -> None:
        """Seize the lease, as an operator with a certificate may."""
        request = LeaseRequest(
            request_id=random.getrandbits(64), action=random.choice((0, 1, 2, 2, 3)), name="mallory"
        )
        note = time_bytes(self._robot_ns() + SOON_NS)
        self._ask(f"{ROBOT}{LEASE_SERVICE.path}/{OWN_NAME}", self._encoder.encode(request), note)

    def replays(self, random: Random) -> None:
        """Replay a captured frame with its attachment."""
        if not self._captured:
            return
        one = random.choice(self._captured)
        if one.asked:
            self._ask(one.key, one.frame, one.note)
        else:
            self._hub.put(self.host, one.key, one.frame, ENCODING, one.note)

    def collides(self, random: Random) -> None:
        """Send a harmless command with the id of another operator's request, or a near one.

        Use that operator's name at times.
        """
        asked = [one for one in self._captured if one.asked and COMMAND.path in one.key]
        if not asked:
            return
        one = random.choice(asked)
        known = decode(one.frame).message
        request = CommandRequest(
            request_id=min(getattr(known, "request_id", 0) + random.choice((0, 1, 2, 3)), MAX_ID),
            param1=1.0,
            param2=0.5,  # which no other process asks
            command=random.choice(HARMLESS),
        )
        key = random.choice((one.key, f"{ROBOT}{COMMAND.path}/{OWN_NAME}"))
        self._ask(key, self._encoder.encode(request), time_bytes(self._robot_ns() + SOON_NS))


ATTACKS: Final[dict[str, Callable[..., None]]] = {
    "wheels": SimulatedAttacker.wheels,
    "senses": SimulatedAttacker.senses,
    "strange": SimulatedAttacker.strange,
    "commands": SimulatedAttacker.commands,
    "stops": SimulatedAttacker.stops,
    "known stops": SimulatedAttacker.known_stops,
    "requests": SimulatedAttacker.requests,
    "orders": SimulatedAttacker.orders,
    "seizes": SimulatedAttacker.seizes,
    "replays": SimulatedAttacker.replays,
    "collides": SimulatedAttacker.collides,
}


def command(number: int, random: Random) -> CommandRequest:
    """Return a command with plausible parameters."""
    return CommandRequest(
        request_id=random.getrandbits(64),
        param1=float(random.choice((0, 1, 1, 4, 10, 15, -1, 1e30))),
        param2=float(random.choice((0, 0, 4, 10, 12, 15, -1))),
        command=number,
    )


def extreme(kind: type[Message], random: Random) -> Message:
    """Return a message with legal, mostly extreme values."""
    fields = LAYOUT[kind.__name__].fields
    return kind(**{field.name: value_of(field, random) for field in fields})


def value_of(field: Field, random: Random) -> Any:
    """Draw a value of a field."""
    if field.is_text:
        return random.choice(("", "x" * (field.length or 1), "d_obs_m"[: field.length or 1]))
    if field.length:
        return tuple(number_of(field, random) for _ in range(field.length))
    return number_of(field, random)


def number_of(field: Field, random: Random) -> float | int:
    """Draw a number of a field."""
    if field.limits is None:
        return random.choice(
            (0.0, 1.0, -1.0, float("nan"), float("inf"), float("-inf"), 3e38, random.uniform(-5, 5))
        )
    low, high = field.limits
    return random.choice((low, high, 0, min(1, high), random.randint(low, high)))
