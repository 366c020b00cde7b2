"""Decoders of the bus and of recordings to fuzz: frames, samples, requests, senses, answers, logs.

Any bytes are read as a row of messages, each in a readable frame. So the content of the fields is
fuzzed, not the frame around them. Of recordings everything that is made of them is tried: replay,
tables, explanations, ghosts, re-execution.
"""

import json
from base64 import b64encode
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from io import BytesIO
from math import nan
from pathlib import Path
from typing import Any, Final, NamedTuple

from fastcrc.crc16 import mcrf4xx
from mcap.writer import CompressionType, Writer

from checks.fuzz.target import JSON_WORDS, REFUSALS, FuzzTarget
from checks.harness.messages import make
from checks.harness.processes import arm_request, auto_goal_request, command_request
from ground.branch_point import GhostRecording, changed_in
from ground.cli.observe.replay import lines
from ground.client.outcomes import NoProgress
from ground.client.parameter import parameters_in
from ground.commands.export import Export
from ground.commands.param import table
from ground.explain import RecordedDecisions as Decided
from ground.map.canvas import Canvas
from ground.map.drawing import draw
from ground.map.scene import View
from ground.missions.transfer import fence_of, waypoints_of
from ground.recording.foxglove_scene import GREY
from ground.recording.log_reader import LogIndex, open_log, record_bytes
from ground.recording.mcap_file import FACT, KEY_TOPIC, KEYS, RAW_TOPIC, McapFormat
from ground.recording.playback import ReplayBus
from ground.recording.tables import TimeAxis, collect_series
from ground.recording.world_metadata import solids, world_of
from ground.station.station import Station
from ground.station.world import parse_world
from plant.world.file import load
from protocol.bus.mailbox import Mailbox, Sample
from protocol.outcome import wire_goal
from protocol.ring import RADIUS_M
from protocol.topics import COMPONENT, ENCODING, PREFIX, SERVICES, TOPICS, Role, operator_in
from protocol.wire.codec import CHECKSUM, HEAD, MAGIC_BYTE, WIRE_OF_TYPE, Encoder, decode
from protocol.wire.enums import (
    FRAME_LOCAL_FLU,
    INPUT_SCAN,
    INPUT_WHEELS,
    Command,
    LeaseAction,
    MissionType,
)
from protocol.wire.message import Message, Wire, check
from protocol.wire.messages import (
    AvoidanceDecision,
    LeaseRequest,
    MissionCount,
    MissionItemInt,
    NavigatorStatus,
    ParamSet,
    PlanarOdometry,
    SonarScan,
    Statustext,
    SystemTime,
    Teleop,
    TickInputs,
    WheelCommand,
    WheelTicks,
)
from protocol.world import as_json
from robot.commands import operator_twist
from robot.core.parameters import DEFAULTS
from robot.core.values import Inputs, Outputs, Scan, Wheels, scan_of, wheels_of
from robot.hosting import InProcessCore
from robot.parameter_service import ParameterService
from robot.parameter_table import described
from robot.storage import Store
from robot.vehicle import RobotVehicle
from runtime.clock import ManualClock
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS, NS_PER_S, PERIOD_MS
from study.cli.reexecute import params_of
from study.cli.reexecute import start_of as started_at
from study.trial.reexecution import RecordedDrive, reexecute, refuse_unless_whole

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
    *(ENCODING, ENCODING, ENCODING),
    *("application/mavlink2;sidestep@2", "", "zenoh/bytes"),
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
ITEM: Final = make(
    MissionItemInt,
    frame=FRAME_LOCAL_FLU,
    command=Command.SIDESTEP_NAV_POSE,
    autocontinue=1,
    param2=0.05,
    param3=3.0,
    param4=nan,
    x=20_000,
    y=10_000,
    mission_type=MissionType.MISSION,
)
COUNT: Final = MissionCount(count=1, mission_type=MissionType.MISSION)
START: Final = command_request(4, Command.MISSION_START)
TEXT: Final = Statustext(severity=6, text="started", id=0, chunk_seq=0)
EXAMPLES: Final[tuple[Message, ...]] = (
    *(ARM, GOAL, SCAN, TICKS, TELEOP),
    *(TAKE, SET, ITEM, COUNT, TEXT),
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
    vehicle, now_ns = RobotVehicle(DEFAULTS, Store(None)), 0
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


def published_by(vehicle: RobotVehicle, now_ns: int) -> list[Message]:
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
    vehicle, now_ms = RobotVehicle(DEFAULTS, Store(None)), 0
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


BEGUN_US: Final = 1_790_000_000_000_000
MOST_ROWS: Final = 20_000
NAME: Final = "20261121T190000Z-r1"
NAN: Final = float("nan")

STATUS = make(
    NavigatorStatus,
    time_ns=50_000_000,
    goal_started_ns=1,
    goal_id=2,
    goal_x_m=4.0,
    goal_y_m=1.0,
    goal_heading_rad=NAN,
    goal_distance_m=3.0,
    vehicle=2,
    mode=10,
    goal=2,
    navigator=2,
)
ODOMETRY = make(
    PlanarOdometry,
    time_ns=50_000_000,
    x_m=0.6,
    y_m=2.0,
    speed_m_s=0.2,
    cov_xx_m2=0.01,
    cov_yy_m2=0.01,
    cov_hh_rad2=0.01,
)
DECISION = make(
    AvoidanceDecision,
    time_ns=50_000_000,
    nearest_bearing_rad=0.2,
    nearest_range_m=0.5,
    zone_m=0.3,
    goal_bearing_rad=0.1,
    virtual_x_m=4.0,
    virtual_y_m=1.0,
    speed_m_s=0.2,
    yaw_rate_rad_s=0.1,
    branch=2,
)
INPUTS = make(
    TickInputs,
    time_ns=50_000_000,
    now_ms=50,
    tick=1,
    wheels_seq=1,
    scan_seq=1,
    scan_age_ms=20,
    flags=INPUT_SCAN | INPUT_WHEELS,
)
COMMAND = WheelCommand(
    time_ns=50_000_000, seq=1, sense_seq=1, left_mrad_s=5, right_mrad_s=5, ttl_ms=150
)
TICK_MESSAGES: Final[tuple[Message, ...]] = (
    *(SCAN, TICKS, INPUTS, COMMAND),
    *(ODOMETRY, STATUS, DECISION, TEXT),
)
"""The messages of a robot in one tick."""


def tick_samples() -> Sequence[bytes]:
    """Return messages in wall time, in lockstep, and with requests in between."""
    clock = SystemTime(time_unix_usec=50_000, time_boot_ms=50)
    return [
        packed(*TICK_MESSAGES * 2),
        packed(clock, *TICK_MESSAGES, clock),
        packed(*TICK_MESSAGES, ARM, GOAL, *TICK_MESSAGES),
    ]


def facts() -> dict[str, str]:
    """Return the facts that a recorder stores."""
    return {
        "world": json.dumps(as_json(load("moving"), 5.0)),
        "parameters": json.dumps(described(DEFAULTS)),
    }


def timed(data: bytes) -> Iterator[tuple[int, str, bytes]]:
    """Yield time in us, key and frame of each message, on the first topic of its type."""
    time_us = BEGUN_US
    for piece in pieces(data):
        time_us += piece.after_ns // 1000
        path = next((one.path for one in TOPICS if type(piece.message) in one.messages), "x")
        yield time_us, f"{PREFIX}/r1/{path}", piece.frame


@cache
def tlogs() -> tuple[bytes, ...]:
    """Return good .tlog files."""
    return tuple(
        b"".join(record_bytes(time_us, frame) for time_us, _, frame in timed(data))
        for data in tick_samples()
    )


@cache
def mcaps() -> tuple[bytes, ...]:
    """Return .mcap files as the recorder writes them, and uncompressed ones."""
    form = McapFormat("r1", {})
    for name, text in facts().items():
        form.add_fact(name, text)
    for time_us, key, frame in timed(tick_samples()[0]):
        form.add(key, frame, time_us)
    recorded = form.batch() + form.end()
    return (recorded, *map(plain, tick_samples()), *map(plain_of_before, tick_samples()))


def plain(data: bytes) -> bytes:
    """Write frames in their native channel, each after its key."""

    def write(writer: Any, frames: Iterable[tuple[int, str, bytes]]) -> None:
        raw = writer.register_channel(RAW_TOPIC, ENCODING, 0, {KEYS: "sidestep/r1"})
        keys = writer.register_channel(KEY_TOPIC, "json", writer.register_schema("key", "", b""))
        for time_us, key, frame in frames:
            text = json.dumps({"key": key}).encode()
            writer.add_message(keys, time_us * 1000, text, time_us * 1000, 0)
            writer.add_message(raw, time_us * 1000, frame, time_us * 1000, 0)

    return written(data, write)


def plain_of_before(data: bytes) -> bytes:
    """Write key and frame as JSON, as in older recordings."""

    def write(writer: Any, frames: Iterable[tuple[int, str, bytes]]) -> None:
        schema = writer.register_schema("raw", "", b"")
        channel = writer.register_channel(RAW_TOPIC, "json", schema)
        for time_us, key, frame in frames:
            raw = json.dumps({"key": key, "frame": b64encode(frame).decode()}).encode()
            writer.add_message(channel, time_us * 1000, raw, time_us * 1000, 0)

    return written(data, write)


def written(data: bytes, write: Callable[[Any, Iterable[tuple[int, str, bytes]]], None]) -> bytes:
    """Return an uncompressed .mcap file without checksums."""
    out = BytesIO()
    writer: Any = Writer(out, compression=CompressionType.NONE, enable_crcs=False)
    writer.start(library="sidestep")
    writer.add_metadata("sidestep", {"robot": "r1"})
    for name, text in facts().items():
        writer.add_metadata(name, {FACT: text})
    write(writer, timed(data))
    writer.finish()
    found: bytes = out.getvalue()
    return found


def mcap_bombs() -> Sequence[bytes]:
    """Return small files that expand to much."""
    return [bomb(1 << 30, 9), bomb(1 << 26, 0), bomb(1 << 26, 9, announced=1 << 60)]


def bomb(size: int, opcode: int, announced: int | None = None) -> bytes:
    """Return a chunk of empty records that is compressed to almost nothing."""
    import zstandard

    block = bytes((0x80 + opcode, *bytes(8))) * (1 << 16)
    squeezer = zstandard.ZstdCompressor().compressobj(size=size // len(block) * len(block))
    data = b"".join(squeezer.compress(block) for _ in range(size // len(block))) + squeezer.flush()
    head = (0).to_bytes(16, "little") + (announced or size).to_bytes(8, "little") + bytes(4)
    content = head + (4).to_bytes(4, "little") + b"zstd" + len(data).to_bytes(8, "little") + data
    return b"\x89MCAP0\r\n\x06" + len(content).to_bytes(8, "little") + content


def use_all(name: str) -> Callable[[bytes, Path], None]:
    """Return a function that uses a recording of this name in every way."""

    def run(data: bytes, folder: Path) -> None:
        path = folder / name
        path.write_bytes(data)
        for use in (play, explain, tabulate, gather_series, load_ghost, run_again):
            with suppress(*REFUSALS):
                use(path)

    return run


def play(path: Path) -> None:
    """Replay a recording and draw its map."""
    bus = ReplayBus(path, ManualClock())
    station = Station(bus, bus.robot, bus.timeline)
    duration_s = bus.timeline.duration_ns / NS_PER_S
    for share in (0.0, 0.5, 1.0):
        bus.seek(duration_s * share)
        station.poll()
        scene = station.scene()
        draw(scene, View.fit(scene.box(), 20, 10), Canvas(20, 10))
        station.streams()
        station.moment()


def explain(path: Path) -> None:
    """Explain the decisions of a recording."""
    bus = ReplayBus(path, ManualClock())
    list(lines(bus, 0.0, max(1.0, bus.timeline.duration_ns / 5e9)))
    decided = Decided(bus.log_index)
    list(decided.turns())
    found = decided.at(bus.log_index.duration_ns)
    if found is not None:
        found[1].text()


def tabulate(path: Path) -> None:
    """Export a recording as tables."""
    for shape in ("long", "wide"):
        out = path.with_suffix(".csv")
        Export(file=str(path), shape=shape, out=str(out)).run(NoProgress())


def gather_series(path: Path) -> None:
    """Read the series and the world of a recording, and write it again."""
    log = open_log(path)
    frames = list(log)
    text = log.facts.get("world", "")
    world = world_of(text)
    collect_series(TimeAxis(open_log(path)), RADIUS_M if world is None else world.radius_m)
    if world is not None:
        solids(world, GREY)
    form = McapFormat("r1", {})
    form.add_fact("world", text)
    for frame in frames:
        form.add(frame.key, frame.frame, frame.time_ns // 1000)
    form.end()


def load_ghost(path: Path) -> None:
    """Load a recording as a ghost."""
    log_index = LogIndex(open_log(path))
    changed_in(log_index.facts.get("parameters", ""))
    footage = GhostRecording(log_index)
    at_ns = footage.beginning_ns()
    footage.rest(at_ns)
    footage.instant(at_ns, None, None)


def run_again(path: Path) -> None:
    """Re-execute a recording."""
    recorded = RecordedDrive(open_log(path))
    refuse_unless_whole(recorded)
    start, _ = started_at(recorded)
    reexecute(recorded, params_of(recorded), start, other=False)


def recording(data: bytes, folder: Path) -> None:
    """Use a recording of readable frames, with the facts of the run beside it."""
    beside = folder / f"{NAME}.mcap"
    if not beside.exists():
        beside.write_bytes(mcaps()[0])
    log = b"".join(record_bytes(time_us, frame) for time_us, _, frame in timed(data))
    use_all(f"{NAME}.tlog")(log, folder)


LOGS: Final = (
    FuzzTarget(name="tlog", samples=tlogs, run=use_all("run.tlog"), allowed=(), weight=5),
    FuzzTarget(
        name="mcap",
        samples=mcaps,
        run=use_all("run.mcap"),
        allowed=(),
        weight=5,
        words=JSON_WORDS,
        bombs=mcap_bombs,
    ),
    FuzzTarget(name="recording", samples=tick_samples, run=recording, allowed=(), weight=8),
)
