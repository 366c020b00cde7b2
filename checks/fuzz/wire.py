"""Decoders of the bus to fuzz: frames, samples, requests, senses, and answers to requests.

Any bytes are read as a row of messages, each in a readable frame. So the content of the fields is
fuzzed, not the frame around them.
"""

import json
from collections.abc import Iterator, Sequence
from math import nan
from pathlib import Path
from typing import Any, Final, NamedTuple

from fastcrc.crc16 import mcrf4xx

from checks.fuzz.target import FuzzTarget
from checks.harness.bus_calls import arm_request, auto_goal_request, command_request
from ground.client.parameter import parameters_in
from ground.commands.param import table
from ground.missions.transfer import fence_of, waypoints_of
from ground.station.world import parse_world
from plant.world.file import load
from protocol.bus.mailbox import Mailbox, Sample
from protocol.outcome import wire_goal
from protocol.topics import COMPONENT, ENCODING, SERVICES, TOPICS, Role, operator_in
from protocol.wire.codec import CHECKSUM, HEAD, MAGIC_BYTE, WIRE_OF_TYPE, Encoder, decode
from protocol.wire.enums import FRAME_LOCAL_FLU, Command, LeaseAction, MissionType
from protocol.wire.message import Message, Wire, check
from protocol.wire.messages import (
    LeaseRequest,
    MissionCount,
    MissionItemInt,
    ParamSet,
    SonarScan,
    Statustext,
    Teleop,
    WheelTicks,
)
from protocol.world import as_json
from robot.commands import operator_twist
from robot.core.parameters import DEFAULTS
from robot.core.values import Inputs, Outputs, Scan, Wheels, scan_of, wheels_of
from robot.hosting import InProcessCore
from robot.parameter_service import ParameterService
from robot.storage import Store
from robot.vehicle import Vehicle
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS, PERIOD_MS

MOST: Final = 60
STEP_NS: Final = 5_000_000


class MessageKind(NamedTuple):
    """A message type with its sender."""

    message: type[Message]
    sender: Role


PUBLISHED: Final = tuple(
    MessageKind(one, topic.publisher) for topic in TOPICS for one in topic.messages
)
REQUESTED: Final = tuple(
    MessageKind(one, Role.GROUND) for service in SERVICES for one in service.requests
)
KINDS: Final = (*PUBLISHED, *REQUESTED)
NUMBER_OF: Final = {kind.message: number for number, kind in reversed(list(enumerate(KINDS)))}


class TimedMessage(NamedTuple):
    """A message, its frame, and the time since the message before."""

    message: Message
    frame: bytes
    after_ns: int


def packed(*messages: Message, after: int = 10) -> bytes:
    """Return the bytes that `pieces` reads as these messages."""
    return b"".join(
        bytes((NUMBER_OF[type(one)], after)) + WIRE_OF_TYPE[type(one)].pack(one) for one in messages
    )


def pieces(data: bytes) -> Iterator[TimedMessage]:
    """Yield messages; each begins with a byte for its kind and one for the time since the last."""
    at = 0
    for sequence in range(MOST):
        if at + 2 > len(data):
            return
        kind, after = KINDS[data[at] % len(KINDS)], data[at + 1]
        wire = WIRE_OF_TYPE[kind.message]
        frame = frame_of(wire, data[at + 2 : at + 2 + wire.size], kind.sender, sequence)
        at += 2 + wire.size
        try:
            yield TimedMessage(decode(frame).message, frame, after * STEP_NS)
        except RemoteError:  # text that is not UTF-8
            continue


def frame_of(wire: Wire, payload: bytes, sender: Role, sequence: int) -> bytes:
    """Return the frame of a payload, with a valid checksum."""
    payload = payload.rstrip(b"\0") or b"\0"
    low, high = wire.number_low, wire.number_high
    body = HEAD(len(payload), 0, 0, sequence & 0xFF, 1, COMPONENT[sender], low, high) + payload
    return MAGIC_BYTE + body + CHECKSUM(mcrf4xx(body + wire.crc_extra))


FULL_MRAD_S: Final = 200_000
CLEAR: Final = Scan((0,) * 8, (0,) * 8, 255, 0)
STILL: Final = Wheels(0, 0, 0, 0)
ENCODINGS: Final = (
    ENCODING,
    ENCODING,
    ENCODING,
    "application/mavlink2;sidestep@2",
    "",
    "zenoh/bytes",
)
OPERATORS: Final = ("", "ada", "bob")

ARM: Final = arm_request(1)
GOAL: Final = auto_goal_request(2, wire_goal(4.0, 1.0, 0.0, 0.05, 0.05236))
SCAN: Final = SonarScan(
    time_ns=50_000_000, seq=1, range_mm=(900,) * 8, ping_age_us=(20_000,) * 8, valid=255, echo=60
)
TICKS: Final = WheelTicks(time_ns=50_000_000, seq=1, left=9, right=9, bumper=0, expired=0)
TELEOP: Final = Teleop(time_ns=1, seq=1, speed_mm_s=200, yaw_rate_mrad_s=300, ttl_ms=300)
TAKE: Final = LeaseRequest(request_id=3, action=LeaseAction.TAKE, name="ada")
SET: Final = ParamSet(param_id="d_obs_m", param_value=0.4, param_type=9)
ITEM: Final = MissionItemInt(
    seq=0,
    frame=FRAME_LOCAL_FLU,
    command=Command.SIDESTEP_NAV_POSE,
    autocontinue=1,
    param1=0.0,
    param2=0.05,
    param3=3.0,
    param4=nan,
    x=20_000,
    y=10_000,
    z=0.0,
    mission_type=MissionType.MISSION,
)
COUNT: Final = MissionCount(count=1, mission_type=MissionType.MISSION)
START: Final = command_request(4, Command.MISSION_START)
TEXT: Final = Statustext(severity=6, text="started", id=0, chunk_seq=0)
EXAMPLES: Final[tuple[Message, ...]] = (
    ARM,
    GOAL,
    SCAN,
    TICKS,
    TELEOP,
    TAKE,
    SET,
    ITEM,
    COUNT,
    TEXT,
)


def frames() -> Sequence[bytes]:
    """Return good frames."""
    encoder = Encoder(1, 1)
    return [encoder.encode(message) for message in EXAMPLES]


def samples() -> Sequence[bytes]:
    """Return good samples; the first byte is the topic, the second encoding and sender."""
    return [bytes((place % len(TOPICS), place)) + one for place, one in enumerate(frames())]


def sample(data: bytes, _: Path) -> None:
    """Store a sample in a mailbox and read it."""
    if len(data) < 2:
        return
    topic = TOPICS[data[0] % len(TOPICS)]
    box: Mailbox[Any] = Mailbox(topic, accept=lambda sender: sender != "bob")
    sender = operator_in(data[2 : 2 + data[1]].decode(errors="replace"))
    box.store(Sample(ENCODINGS[data[1] % len(ENCODINGS)], data[2:], sender), 0)
    box.latest()
    box.fresh(1)


def requests(data: bytes, _: Path) -> None:
    """Answer requests with messages that can be sent, and step the robot."""
    vehicle, now_ns = Vehicle(DEFAULTS, Store(None)), 0
    encoder = Encoder(1, 1)
    for place, piece in enumerate(pieces(data)):
        now_ns += PERIOD_MS * NS_PER_MS
        operator = OPERATORS[place % len(OPERATORS) if piece.after_ns % 2 else 0]
        if isinstance(piece.message, Teleop):
            vehicle.receive_teleop(piece.message, now_ns)
        else:
            encoder.encode(vehicle.receive(piece.message, now_ns, operator))
        inputs = Inputs(now_ns // NS_PER_MS, STILL, CLEAR, vehicle.operator_age_ms(now_ns))
        judge(vehicle.step(inputs, lambda _: None, operator_twist(vehicle.teleop.newest(now_ns))))
        for message in published_by(vehicle, now_ns):
            check(message)


def published_by(vehicle: Vehicle, now_ns: int) -> list[Message]:
    """Return the messages that a robot publishes."""
    found = [
        vehicle.heartbeat(now_ns),
        vehicle.lease_status(now_ns, now_ns),
        vehicle.mission_status(now_ns, now_ns),
        *vehicle.texts(),
    ]
    return [one for one in found if one is not None]


def senses(data: bytes, _: Path) -> None:
    """Step a driving robot with any senses."""
    vehicle, now_ms = Vehicle(DEFAULTS, Store(None)), 0
    scan, wheels = CLEAR, STILL
    for piece in pieces(packed(SCAN, ARM, GOAL) + data):
        now_ms += piece.after_ns // NS_PER_MS
        message = piece.message
        if isinstance(message, SonarScan):
            scan = scan_of(message, 20)
        elif isinstance(message, WheelTicks):
            wheels = wheels_of(message)
        else:
            vehicle.receive(message, now_ms * NS_PER_MS)
        judge(vehicle.step(Inputs(now_ms, wheels, scan, None), lambda _: None))


def judge(outputs: Outputs) -> None:
    """Check that wheel speeds are integers within limits."""
    for speed in (outputs.left_mrad_s, outputs.right_mrad_s):
        if not isinstance(speed, int) or abs(speed) > FULL_MRAD_S:
            raise AssertionError(f"invalid wheel speed {speed!r} mrad/s")


def download(data: bytes, _: Path) -> None:
    """Read a mission and a fence as another robot might send them."""
    items = [one.message for one in pieces(data) if isinstance(one.message, MissionItemInt)]
    for read in (waypoints_of, fence_of):
        try:
            str(read(items))
        except RemoteError:
            continue


def parameters() -> Sequence[bytes]:
    """Return good parameter lists."""
    described = ParameterService(InProcessCore(DEFAULTS), Store(None), None)
    return [described.describe(), b'[{"name": "side", "value": 1, "default": 1, "unit": ""}]']


def parameter_list(data: bytes, _: Path) -> None:
    """Read a parameter list and make a table of it."""
    table(parameters_in(data))


def world_texts() -> Sequence[bytes]:
    """Return good worlds as JSON."""
    return [json.dumps(as_json(load(name), 5.0)).encode() for name in ("box", "moving", "corner")]


def deep() -> Sequence[bytes]:
    """Return deep JSON and long numbers."""
    return [b"[" * 100_000, b'{"a":' * 100_000, b"[" + b"9" * 5000 + b"]", b"[1e999, -1e999, NaN]"]


WIRE: Final = (
    FuzzTarget(
        name="frame",
        samples=frames,
        run=lambda data, _: decode(data),
        allowed=(RemoteError,),
        weight=300,
    ),
    FuzzTarget(name="sample", samples=samples, run=sample, allowed=(), weight=150),
    FuzzTarget(
        name="requests",
        samples=lambda: [packed(ARM, GOAL, SET, TAKE, TELEOP), packed(COUNT, ITEM, ARM, START)],
        run=requests,
        allowed=(),
    ),
    FuzzTarget(
        name="senses",
        samples=lambda: [packed(*(SCAN, TICKS) * 8), packed(*(TICKS, SCAN, SET) * 5)],
        run=senses,
        allowed=(),
    ),
    FuzzTarget(name="download", samples=lambda: [packed(*[ITEM] * 4)], run=download, allowed=()),
    FuzzTarget(name="parameter_list", samples=parameters, run=parameter_list, bombs=deep),
    FuzzTarget(
        name="world_facts",
        samples=world_texts,
        run=lambda data, _: parse_world(data),
        bombs=deep,
    ),
)
