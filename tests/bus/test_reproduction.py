"""A run is reproducible from its bus traffic, and executed again from its recording."""

from collections.abc import Container, Iterator, Mapping, Sequence
from functools import partial
from itertools import dropwhile
from pathlib import Path
from threading import Lock
from typing import Final, TypeAlias, TypeVar

from msgspec.structs import replace

from checks.harness.in_process import InProcess
from ground.recording.log_reader import open_log
from ground.recording.mcap_file import McapFormat
from protocol.topics import ANSWERED, COMMANDED, INPUTS, SONAR, WHEELS, Topic
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import INPUT_SCAN, INPUT_TELEOP, INPUT_WHEELS
from protocol.wire.limits import NEVER_MS
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    LeaseRequest,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    TickInputs,
    WheelCommand,
    WheelTicks,
)
from robot import telemetry
from robot.core.parameters import Params
from robot.core.values import Inputs, Outputs, Pose, scan_of, twist_of, wheels_of
from robot.storage import Store
from robot.vehicle import RobotVehicle
from study.cli.reexecute import params_of, start_of
from study.trial.reexecution import (
    RecordedDrive,
    RecordedRequest,
    reason_in,
    reexecute,
    refuse_unless_whole,
)
from tests.support.stacks import drive_about

M = TypeVar("M", bound=Message)
Heard: TypeAlias = Sequence[Mapping[int, Message]]
TOLD: Final = (WheelCommand, PlanarOdometry, AvoidanceDecision, NavigatorStatus)


class Tape:
    """Collect each frame on the bus by type, and by key where several topics share a type."""

    def __init__(self, stack: InProcess) -> None:
        self._lock = Lock()
        self.frames: list[tuple[str, Message]] = []
        stack.ground.stream_all(self._take)

    def _take(self, key: str, frame: bytes, _arrived_ns: int) -> None:
        with self._lock:
            self.frames.append((key, decode(frame).message))

    def on(self, topic: Topic[Message]) -> list[Message]:
        return [message for key, message in self.frames if key.endswith(topic.path)]

    def requests(self) -> list[tuple[Message, Message]]:
        """Return each recorded request with its answer."""
        return list(zip(self.on(COMMANDED), self.on(ANSWERED), strict=True))

    def of(self, kind: type[M]) -> list[M]:
        return [message for _, message in self.frames if isinstance(message, kind)]

    def by_time(self, kind: type[M]) -> dict[int, M]:
        return {getattr(message, "time_ns", 0): message for message in self.of(kind)}


def again(
    tape: Tape, heard: Heard, params: Params, start: Pose
) -> Iterator[tuple[TickInputs, RobotVehicle, Outputs]]:
    """Repeat the run, without a plant, an operator or a bus."""
    vehicle = RobotVehicle(params, Store(None), start)
    wheels = {one.seq: one for one in tape.of(WheelTicks)}
    scans = {one.seq: one for one in tape.of(SonarScan)}
    requests, done = tape.requests(), 0
    for given in dropwhile(partial(unheard, wheels, scans, heard), tape.of(TickInputs)):
        for request, answer in requests[done : given.requests]:
            recorded = RecordedRequest(request, reason_in(answer))
            is_of_lease = isinstance(request, LeaseRequest)
            if recorded.was_acted_on(vehicle.state.machine) and not is_of_lease:
                vehicle.receive(request, given.now_ms * 1_000_000)
        done, flags = given.requests, given.flags
        ticks = wheels_of(wheels[given.wheels_seq]) if flags & INPUT_WHEELS else None
        seen = scans[given.scan_seq] if flags & INPUT_SCAN else None
        scan = None if seen is None else scan_of(seen, given.scan_age_ms)
        age_ms = None if given.operator_age_ms == NEVER_MS else given.operator_age_ms
        steered = flags & INPUT_TELEOP
        manual = twist_of(given.speed_mm_s, given.yaw_rate_mrad_s) if steered else None
        inputs = Inputs(given.now_ms, ticks, scan, age_ms)
        yield given, vehicle, vehicle.step(inputs, lambda _: None, manual)


def unheard(wheels: Container[int], scans: Container[int], heard: Heard, given: TickInputs) -> bool:
    """Return whether an idle tick has samples or messages from before the tape had all topics.

    A tick without a new scan goes by the one before, which the tape may have missed.
    """
    if given.requests:
        return False
    both = INPUT_WHEELS | INPUT_SCAN
    samples = given.flags & both == both
    samples = samples and given.wheels_seq in wheels and given.scan_seq in scans
    return not samples or any(given.time_ns not in messages for messages in heard)


def test_full_run_is_reproduced_bit_by_bit() -> None:
    with InProcess("box", noise="default", seed=4) as stack:
        tape = Tape(stack)
        stack.until(
            lambda: bool(tape.of(TickInputs) and tape.of(WheelTicks) and tape.of(SonarScan)),
            within_s=2.0,
        )
        start, params = stack.vehicle.state.odometry.pose, stack.vehicle.params
        drive_about(stack)
    compare(tape, params, start)


def compare(tape: Tape, params: Params, start: Pose) -> None:
    heard: Heard = [tape.by_time(kind) for kind in TOLD]
    ticks = steered = 0
    for given, vehicle, outputs in again(tape, heard, params, start):
        said = said_again(given, vehicle, outputs, heard[0][given.time_ns])
        for ours, theirs in zip(said, heard, strict=True):
            assert wire(ours) == wire(theirs[given.time_ns])
        ticks += 1
        steered += bool(given.flags & INPUT_TELEOP)
    assert ticks > 200
    assert steered > 10


def said_again(
    given: TickInputs, vehicle: RobotVehicle, outputs: Outputs, sent: Message
) -> list[Message]:
    """Return the messages of a tick, with the counters of the command that was sent."""
    at_ns = given.time_ns
    wheels = {"left_mrad_s": outputs.left_mrad_s, "right_mrad_s": outputs.right_mrad_s}
    return [
        replace(sent, **wheels),
        telemetry.odometry(vehicle.state, at_ns),
        telemetry.decision(outputs, vehicle.zone_m, at_ns),
        telemetry.status(vehicle.state, vehicle.commands.goal_id, at_ns, given.now_ms),
    ]


def wire(message: Message) -> bytes:
    """Encode as on the bus, so that two NaN values compare equal."""
    return Encoder(1, 1).encode(message)


def test_all_commands_and_lost_samples_are_reproduced(tmp_path: Path) -> None:
    form, lock, path = McapFormat("r1", {}), Lock(), tmp_path / "a.mcap"
    heard: set[str] = set()

    def take(key: str, frame: bytes, arrived_ns: int) -> None:
        heard.add(key)
        with lock:
            form.add(key, frame, 1_790_000_000_000_000 + arrived_ns // 1000)

    with InProcess("box", noise="default", seed=4) as stack:
        stack.ground.stream_all(take)
        form.add_fact("parameters", stack.vehicle.parameters.describe().decode())
        prefix = stack.ground.network.prefix
        needed = {topic.key("r1", prefix) for topic in (WHEELS, SONAR, INPUTS)}
        stack.until(lambda: needed <= heard, within_s=1.0)
        stack.forward(0.1)  # ticks recorded completely, before the first request
        drive_about(stack)
    with lock:
        path.write_bytes(form.end())
    recorded = RecordedDrive(open_log(path))
    refuse_unless_whole(recorded)
    start, _ = start_of(recorded)
    verdict = reexecute(recorded, params_of(recorded), start)
    assert verdict.first is None
    assert verdict.compared > 200, verdict.lack
    assert verdict.lack or verdict.compared == len(recorded.ticks), "a busy bus may drop a frame"
