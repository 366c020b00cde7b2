"""A short run as the bus would carry it, files made of it, and recorders without processes."""

import fcntl
import json
import subprocess
import tempfile
from base64 import b64encode
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from io import BytesIO
from itertools import count
from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

from mcap.writer import Writer

from checks.harness.messages import make
from ground.launch.child_processes import Child, Children
from ground.launch.recording_session import created_line
from ground.recording.log_reader import record_bytes, robot_in
from ground.recording.mcap_file import McapFormat
from protocol.topics import (
    ANSWERED,
    COMMANDED,
    DECISION,
    HEARTBEAT,
    ODOMETRY,
    OPERATOR,
    SONAR,
    STATUS,
    TEXT,
    TRUTH,
    WHEELS,
    Topic,
    sender_of,
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import GoalState, Severity, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CommandAck,
    GoalRequest,
    GroundTruth,
    Heartbeat,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    Statustext,
    SystemTime,
    WheelTicks,
)
from runtime.clock import ManualClock

START_US = 1_790_000_000_000_000
PERIOD_US = 50_000
BEAT = make(Heartbeat, custom_mode=15, system_status=4)
WORLD = {
    "name": "made",
    "size_m": [6.0, 4.0],
    "walls": True,
    "start": {"x_m": 0.6, "y_m": 2.0, "heading_deg": 0.0},
    "goal": {"x_m": 5.4, "y_m": 2.0, "heading_deg": 0.0},
    "obstacles": [
        {"polygon_m": [[2.0, 1.0], [3.0, 1.0], [3.0, 1.5]]},
        {"wall_m": [[0.0, 3.0], [2.0, 3.0], [2.5, 2.5]], "thickness_m": 0.02},
        {"circle_m": {"x": 4.0, "y": 3.0, "radius": 0.25}},
        {
            "circle_m": {"x": 5.0, "y": 1.0, "radius": 0.2},
            "path_m": [[5.0, 1.0], [5.0, 3.0]],
            "speed_m_s": 0.1,
        },
    ],
    "robot": {"radius_m": 0.15},
}
WORLD_TEXT = json.dumps(WORLD)


class PublishedFrame(NamedTuple):
    """One frame on its key, at its time."""

    key: str
    frame: bytes
    time_us: int
    message: Message


class TopicEncoder:
    """Encodes each topic's messages as its publisher does."""

    def __init__(self, robot: str = "r1") -> None:
        self.robot = robot
        self._encoders: dict[str, Encoder] = {}

    def publish(self, topic: Topic[Message], message: Message, time_us: int) -> PublishedFrame:
        encoder = self._encoders.setdefault(
            topic.path, Encoder(*sender_of(topic.publisher, self.robot))
        )
        return PublishedFrame(topic.key(self.robot), encoder.encode(message), time_us, message)


def odometry(
    time_ns: int, x_m: float, y_m: float = 2.0, heading_rad: float = 0.0
) -> PlanarOdometry:
    return make(
        PlanarOdometry,
        time_ns=time_ns,
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading_rad,
        speed_m_s=0.25,
        cov_xx_m2=0.0001,
        cov_yy_m2=0.0004,
        cov_hh_rad2=0.0001,
    )


def scan(time_ns: int, seq: int, echo: int = 0b11000) -> SonarScan:
    ranges = tuple(800 + sonar for sonar in range(8))
    return make(SonarScan, time_ns=time_ns, seq=seq, range_mm=ranges, echo=echo)


def status(
    time_ns: int,
    goal: GoalState = GoalState.DRIVING,
    vehicle: Vehicle = Vehicle.ACTIVE,
    vehicle_reason: int = 0,
) -> NavigatorStatus:
    there = goal != GoalState.NONE
    return make(
        NavigatorStatus,
        time_ns=time_ns,
        goal_started_ns=1 if there else 0,
        goal_id=7 if there else 0,
        goal_x_m=5.4 if there else nan,
        goal_y_m=2.0 if there else nan,
        goal_heading_rad=0.0 if there else nan,
        goal_distance_m=1.0,
        vehicle=vehicle,
        goal=goal,
        vehicle_reason=vehicle_reason,
    )


def decision(time_ns: int, virtual: tuple[float, float] = (1.0, 2.5)) -> AvoidanceDecision:
    return make(
        AvoidanceDecision,
        time_ns=time_ns,
        nearest_bearing_rad=0.1,
        nearest_range_m=0.8,
        zone_m=0.3,
        rotation_rad=0.5,
        virtual_x_m=virtual[0],
        virtual_y_m=virtual[1],
        speed_m_s=0.25,
        yaw_rate_rad_s=0.1,
        branch=1,
    )


def truth(time_ns: int, x_m: float) -> GroundTruth:
    return make(GroundTruth, time_ns=time_ns, x_m=x_m, y_m=2.01, speed_m_s=0.25, clearance_m=0.5)


GOAL = make(
    GoalRequest,
    request_id=7,
    x_mm=5400,
    y_mm=2000,
    position_tolerance_mm=50,
    heading_tolerance_urad=52_360,
    mode=15,
)


def run(ticks: int = 40, robot: str = "r1") -> Iterator[PublishedFrame]:
    """Record a goal that is given in tick 10 and reached five ticks before the end."""
    encoder = TopicEncoder(robot)
    for tick in range(ticks):
        at_us, at_ns = START_US + tick * PERIOD_US, tick * PERIOD_US * 1000
        x_m = 0.6 + 0.0125 * max(0, tick - 10)
        yield encoder.publish(WHEELS, wheels(at_ns, tick), at_us)
        yield encoder.publish(SONAR, scan(at_ns, tick), at_us + 100)
        yield encoder.publish(TRUTH, truth(at_ns, x_m), at_us + 200)
        if tick == 10:
            yield encoder.publish(COMMANDED, GOAL, at_us + 250)
            ack = CommandAck(command=192, result=0, result_param2=0)
            yield encoder.publish(ANSWERED, ack, at_us + 260)
        goal = GoalState.NONE if tick < 10 else GoalState.DRIVING
        if tick >= ticks - 5:
            goal = GoalState.REACHED
        yield encoder.publish(ODOMETRY, odometry(at_ns, x_m), at_us + 300)
        yield encoder.publish(STATUS, status(at_ns, goal), at_us + 400)
        yield encoder.publish(DECISION, decision(at_ns, (1.0 + x_m, 2.5)), at_us + 500)
        if tick % 4 == 0:
            yield encoder.publish(HEARTBEAT, BEAT, at_us + 600)
            yield encoder.publish(OPERATOR, BEAT, at_us + 700)
    text = Statustext(severity=Severity.INFO, text="goal reached")
    yield encoder.publish(TEXT, text, START_US + ticks * PERIOD_US)


def wheels(time_ns: int, tick: int) -> WheelTicks:
    return WheelTicks(time_ns=time_ns, seq=tick, left=tick, right=tick, bumper=0, expired=0)


def tlog(path: Path, frames_sent: list[PublishedFrame]) -> Path:
    path.write_bytes(b"".join(record_bytes(one.time_us, one.frame) for one in frames_sent))
    return path


def mcap(
    path: Path, frames_sent: list[PublishedFrame], every: int = 30, *, closed: bool = True
) -> Path:
    """Chunks of `every` frames; the world is known after the first."""
    form = McapFormat("r1", {"version": "0", "commit": "c0ffee", "dialect": "sidestep@2"})
    data = b""
    for number, one in enumerate(frames_sent, 1):
        form.add(one.key, one.frame, one.time_us)
        if number % every == 0:
            data += form.batch()
        if number == every:
            form.add_fact("world", WORLD_TEXT)
    data += form.end() if closed else form.batch()
    path.write_bytes(data)
    return path


def mcap_of_before(path: Path, frames_sent: list[PublishedFrame]) -> Path:
    """Write the format of earlier versions: key and frame in JSON, the frame in base64."""
    out = BytesIO()
    writer: Any = Writer(out)
    writer.start(library="sidestep")
    writer.add_metadata("sidestep", {"robot": "r1"})
    channel = writer.register_channel(
        "/mavlink", "json", writer.register_schema("sidestep.MavlinkFrame", "jsonschema", b"{}")
    )
    for one in frames_sent:
        raw = json.dumps({"key": one.key, "frame": b64encode(one.frame).decode()}).encode()
        writer.add_message(channel, one.time_us * 1000, raw, one.time_us * 1000)
    writer.finish()
    path.write_bytes(out.getvalue())
    return path


def system_time(time_us: int) -> SystemTime:
    return SystemTime(time_unix_usec=time_us, time_boot_ms=time_us // 1000)


class PrintingChildren(Children):
    """Children without processes, whose output a test writes."""

    def __init__(self) -> None:
        super().__init__(ManualClock())
        self._pids = count(7)

    def start(self, role: str, arguments: Sequence[str]) -> None:
        process = SimpleNamespace(pid=next(self._pids), poll=lambda: None)
        output = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `stop`
        child = Child(role, cast("subprocess.Popen[bytes]", process), output)
        self._children.append(child)

    def print_name(self, log: Path, before: str = "") -> None:
        """Let the newest recorder print its line, after another text."""
        output = self._children[-1].output
        output.write(f"{before}{created_line(robot_in(log), log)}\n".encode())
        output.flush()

    def stop(self) -> None:
        for child in self._children:
            child.output.close()
        self._children.clear()


@contextmanager
def written(*paths: Path) -> Iterator[None]:
    """Hold the lock of a writer on these files."""
    with ExitStack() as held:
        for path in paths:
            file = held.enter_context(path.open("rb"))
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


@contextmanager
def printing_children() -> Iterator[PrintingChildren]:
    """Provide such children and close their outputs."""
    children = PrintingChildren()
    try:
        yield children
    finally:
        children.stop()


TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "integer": (int,),
    "number": (int, float),
    "boolean": (bool,),
    "null": (type(None),),
}


def problem(schema: dict[str, Any], value: Any, where: str = "") -> str:
    """Return what violates the schema, and where; empty when all is valid."""
    kinds = schema.get("type", list(TYPES))
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if not isinstance(value, tuple(kind for name in kinds for kind in TYPES[name])):
        return f"{where}: {value!r} is none of {kinds}"
    if isinstance(value, bool) and "boolean" not in kinds:
        return f"{where}: {value!r} is a boolean"
    if isinstance(value, dict):
        return _of_object(schema, value, where)
    if isinstance(value, list):
        low, high = schema.get("minItems", 0), schema.get("maxItems", len(value))
        if not low <= len(value) <= high:
            return f"{where}: {len(value)} items"
        checked = (problem(schema["items"], inner, f"{where}[]") for inner in value)
        return next((found for found in checked if found), "")
    if isinstance(value, int | float) and not (
        schema.get("minimum", value) <= value <= schema.get("maximum", value)
    ):
        return f"{where}: {value} is out of range"
    return ""


def _of_object(schema: dict[str, Any], value: dict[str, Any], where: str) -> str:
    known = schema.get("properties", {})
    for name in schema.get("required", ()):
        if name not in value:
            return f"{where}.{name} is missing"
    for name, inner in value.items():
        if name not in known:
            return f"{where}.{name} is not in the schema"
        if found := problem(known[name], inner, f"{where}.{name}"):
            return found
    return ""
