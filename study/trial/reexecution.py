"""Re-execute a recording: its inputs, tick by tick, with the robot of this build.

Its outputs are compared bit by bit with the recorded ones. With another navigator this is an open
loop: the inputs remain those of the recorded path.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, takewhile
from typing import Final, NamedTuple

from ground.recording.log_reader import Log
from protocol.topics import ANSWERED, COMMANDED, INPUTS
from protocol.wire.codec import Frame, decode
from protocol.wire.enums import (
    INPUT_BUDGET,
    INPUT_NAME_TAKEN,
    INPUT_SCAN,
    INPUT_TELEOP,
    INPUT_WHEELS,
    Command,
)
from protocol.wire.limits import NEVER_MS
from protocol.wire.message import Message, wire_of
from protocol.wire.messages import (
    AvoidanceDecision,
    CommandAck,
    CommandRequest,
    LeaseRequest,
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    MissionVerdict,
    NavigatorStatus,
    ParamRequestRead,
    ParamSet,
    PlanarOdometry,
    SonarScan,
    TickInputs,
    WheelCommand,
    WheelTicks,
)
from protocol.wire.reasons import Reason
from robot import telemetry
from robot.commands import kind_of
from robot.core import reasons
from robot.core.modes import Machine
from robot.core.parameters import Params
from robot.core.values import Inputs, Outputs, Pose, scan_of, twist_of, wheels_of
from robot.storage import Store
from robot.vehicle import RobotVehicle
from runtime.errors import RemoteError, UserError
from runtime.sequence import MAX_LATE_TICKS, Order, order_of
from runtime.units import NS_PER_MS, NS_PER_S

BYTE: Final = 0xFF

PREPARES: Final = (
    *(MissionCount, MissionItemInt, MissionClearAll, MissionRequestList, MissionRequestInt),
    *(ParamRequestRead, ParamSet),
)
"""Requests that only set the initial state of a robot that has not moved yet, as an emergency stop
does. A restarted robot restores its stop, its fence and its mission with them."""

IGNORED: Final = (
    Reason.LEASE_HELD,
    Reason.FENCE_LEAVES_ROBOT_OUT,
    Reason.LESS_SAFE_THAN_CONFIGURED,
    Reason.PARAMETERS_DAMAGED,
    Reason.NEWER_STOP,
)
"""Refusals whose cause is not in the recorded inputs, or is recorded later."""

OUTPUTS: Final = (WheelCommand, AvoidanceDecision, PlanarOdometry, NavigatorStatus)

Key = tuple[int, int]
"""Time stamp and MAVLink sequence number, equal for all frames of one tick."""


class RecordedRequest(NamedTuple):
    """A recorded request, and the reason in its answer."""

    message: Message
    reason: int

    def was_acted_on(self, machine: Machine) -> bool:
        """Return whether the robot has acted on it, in this state.

        Without any operator the core refuses; with another one it never saw the request, because
        the program that sent it sent no heartbeats.
        """
        is_absent = self.reason == Reason.NO_OPERATOR and machine.operator
        return self.reason not in IGNORED and not is_absent


class RecordedDrive:
    """The control ticks of one recording, in order.

    Missing data is found by `lack` when a tick is read.
    """

    def __init__(self, log: Log) -> None:
        self.facts: Mapping[str, str] = log.facts
        self.ticks: list[tuple[TickInputs, int]] = []
        """The inputs of each tick, and the sequence number of their frame."""
        self.ends = ""
        """Why the recording cannot be used after the last tick; empty at its normal end."""
        self._wheels: dict[int, WheelTicks] = {}
        self._scans: dict[int, SonarScan] = {}
        self.fence_lost = False
        """The robot could not read its stored fence; no request shows this."""
        self._outputs: dict[tuple[type[Message], Key], Message] = {}
        self._commands: list[tuple[int, Message]] = []
        self._answers: list[tuple[int, Message]] = []
        for one in log:
            if self.ends:
                continue  # read to the end: the log then knows what it has lost
            try:
                self._take(one.key, decode(one.frame))
            except RemoteError:
                continue
        self.robot = log.robot
        self.damage = log.damage()
        self.requests = self._paired()
        self.prepared = len(list(takewhile(self._prepares, count(1))))
        """Number of requests, from the first on, that only prepare the robot."""
        del self.ticks[: self._beginning()]

    def _take(self, key: str, frame: Frame) -> None:
        message, sequence = frame.message, frame.sequence
        if isinstance(message, WheelTicks):
            self._wheels.setdefault(message.seq, message)
        elif isinstance(message, SonarScan):
            self._scans.setdefault(message.seq, message)
        elif isinstance(message, TickInputs) and key.endswith(INPUTS.path):
            if self.ticks and restarted(self.ticks[-1][0], message):
                self.ends = "robot or plant was restarted"
            else:
                self.ticks.append((message, sequence))
        elif isinstance(message, OUTPUTS):
            self._outputs.setdefault((type(message), (message.time_ns, sequence)), message)
            if isinstance(message, NavigatorStatus):
                self.fence_lost |= message.vehicle_reason == Reason.FENCE_UNREADABLE
        elif key.endswith(COMMANDED.path):
            self._commands.append((sequence, message))
        elif key.endswith(ANSWERED.path):
            self._answers.append((sequence, message))

    def _paired(self) -> dict[int, RecordedRequest]:
        """Return the requests by number from 1, which the sequence of their frames counts."""
        answers = dict(_unwrapped(self._answers))
        return {
            place + 1: RecordedRequest(message, reason_in(answers.get(place)))
            for place, message in _unwrapped(self._commands)
        }

    def _beginning(self) -> int:
        """Return the first tick from which all is recorded while the robot is idle.

        A recorder may receive the robot's messages before those of the plant; skipping those ticks
        loses nothing.
        """
        idle = len(list(takewhile(self._at_rest, self.ticks)))
        after = max((place + 1 for place in range(idle) if self.lack(place)), default=0)
        return after if after < idle else 0

    def _prepares(self, number: int) -> bool:
        request = self.requests.get(number)
        if request is None:
            return False
        return isinstance(request.message, PREPARES) or kind_of(request.message).is_emergency_stop

    def _at_rest(self, tick: tuple[TickInputs, int]) -> bool:
        """Return whether the robot had no request to act on and no teleoperation."""
        inputs, _ = tick
        return inputs.requests <= self.prepared and not inputs.flags & INPUT_TELEOP

    def output(self, kind: type[Message], inputs: TickInputs, sequence: int) -> Message | None:
        """Return the message of this kind that a tick produced; None if not recorded."""
        return self._outputs.get((kind, (inputs.time_ns, sequence)))

    def senses(self, inputs: TickInputs) -> tuple[WheelTicks | None, SonarScan | None]:
        """Return the samples used in a tick; None for a stale or missing sample."""
        is_used = inputs.flags & INPUT_WHEELS
        wheels = self._wheels.get(inputs.wheels_seq) if is_used else None
        scan = self._scans.get(inputs.scan_seq) if inputs.flags & INPUT_SCAN else None
        return wheels, scan

    def lack(self, place: int) -> str:
        """Describe what of a tick is not in the recording; empty if it is complete."""
        inputs, sequence = self.ticks[place]
        before = self.ticks[place - 1] if place else None
        if before is not None and (sequence - before[1]) & BYTE != 1:
            return "the inputs of the tick before are not recorded"
        wheels, scan = self.senses(inputs)
        if wheels is None and inputs.flags & INPUT_WHEELS:
            return f"its input, wheel ticks {inputs.wheels_seq}, is not recorded"
        if scan is None and inputs.flags & INPUT_SCAN:
            return f"its input, sonar scan {inputs.scan_seq}, is not recorded"
        requests_before = before[0].requests if before is not None else 0
        missing = [
            n for n in range(requests_before + 1, inputs.requests + 1) if n not in self.requests
        ]
        return f"request {missing[0]}, which came before it, is not recorded" if missing else ""


def restarted(before: TickInputs, now: TickInputs) -> bool:
    """Return whether the robot or the plant restarted its counters between two ticks."""
    return now.tick < before.tick or Order.RESTARTED in (
        order_of(now.wheels_seq, before.wheels_seq, MAX_LATE_TICKS),
        order_of(now.scan_seq, before.scan_seq, MAX_LATE_TICKS),
    )


def reason_in(answer: Message | None) -> int:
    """Return the reason code in an answer; `Reason.NONE` if it has none."""
    if isinstance(answer, CommandAck):
        return answer.result_param2
    return answer.reason if isinstance(answer, MissionVerdict) else Reason.NONE


def _unwrapped(counted: list[tuple[int, Message]]) -> list[tuple[int, Message]]:
    """Unwrap one-byte sequence numbers; at most 255 messages in a row may be lost."""
    found: list[tuple[int, Message]] = []
    place = -1
    for sequence, message in counted:
        place += (sequence - place) & BYTE or (BYTE + 1 if found else 0)
        found.append((place, message))
    return found


REFUSED: Final = "the recording cannot be re-executed"
COMPARED: Final = (WheelCommand, AvoidanceDecision, PlanarOdometry, NavigatorStatus)
UNCOMPARED: Final = frozenset(
    {"seq", "sense_seq", "epoch", "ttl_ms", "goal_started_ns", "goal_ended_ns"}
    | {"ended_by", "held_by"}
)
"""Counters, times of requests, and names of their senders, which are no input of a tick."""


class Difference(NamedTuple):
    """The first differing value."""

    tick: int
    time_s: float
    message: str
    field: str
    recorded: float
    now: float


@dataclass(slots=True)
class ReexecutionResult:
    """The number of equal ticks, the first difference, and what ended the run early.

    Some outputs of `unrecorded` ticks are not in the recording, so they were not compared.
    """

    ticks: int
    compared: int = 0
    differing: int = 0
    unrecorded: int = 0
    first: Difference | None = None
    lack: str = ""


def _ignore_stage(_stage: int) -> None:
    """Skip the timing of a stage."""


class Reexecution:
    """The robot of this build, driven by the inputs of a recording."""

    def __init__(
        self,
        recorded: RecordedDrive,
        params: Params,
        start: Pose,
        totals: tuple[int, int],
        *,
        other: bool,
    ) -> None:
        """Create the robot; with `other`, requests that choose a navigator are skipped."""
        self._recorded = recorded
        self._other = other
        self._vehicle = RobotVehicle(params, Store(None), start, totals=totals)
        self._vehicle.parameters.configured = None  # refusals that depend on it are skipped
        if recorded.fence_lost:
            self._vehicle.core.lose_fence()
        self._requests_done = 0

    def step(self, inputs: TickInputs) -> Outputs:
        """Run one tick as `robot.process` does."""
        now_ns = inputs.now_ms * NS_PER_MS
        for number in range(self._requests_done + 1, inputs.requests + 1):
            self._receive(number, now_ns)
        self._requests_done = inputs.requests
        if inputs.flags & INPUT_BUDGET:
            self._vehicle.core.report(reasons.BUDGET)
        if inputs.flags & INPUT_NAME_TAKEN:
            self._vehicle.core.report(reasons.NAME_TAKEN)
        is_teleoperated = inputs.flags & INPUT_TELEOP
        manual = twist_of(inputs.speed_mm_s, inputs.yaw_rate_mrad_s) if is_teleoperated else None
        return self._vehicle.step(self._inputs(inputs), _ignore_stage, manual)

    def messages(self, outputs: Outputs, inputs: TickInputs) -> tuple[Message, ...]:
        """Return the messages that the robot would publish, in the order of COMPARED."""
        vehicle, time_ns = self._vehicle, inputs.time_ns
        command = WheelCommand(
            time_ns=time_ns,
            seq=0,
            sense_seq=0,
            left_mrad_s=outputs.left_mrad_s,
            right_mrad_s=outputs.right_mrad_s,
            ttl_ms=0,
        )
        goal_id, stop_id = vehicle.commands.goal_id, vehicle.commands.take_shown_stop()
        return (
            command,
            telemetry.decision(outputs, vehicle.zone_m, time_ns),
            telemetry.odometry(vehicle.state, time_ns),
            telemetry.status(vehicle.state, goal_id, time_ns, inputs.now_ms, stop_id),
        )

    def _inputs(self, given: TickInputs) -> Inputs:
        wheels, scan = self._recorded.senses(given)
        age_ms = None if given.operator_age_ms == NEVER_MS else given.operator_age_ms
        return Inputs(
            given.now_ms,
            None if wheels is None else wheels_of(wheels),
            None if scan is None else scan_of(scan, given.scan_age_ms),
            age_ms,
        )

    def _receive(self, number: int, now_ns: int) -> None:
        recorded, vehicle = self._recorded.requests[number], self._vehicle
        skipped = self._other and chooses_navigator(recorded.message)
        skipped = skipped or isinstance(recorded.message, LeaseRequest)
        if recorded.was_acted_on(vehicle.state.machine) and not skipped:
            vehicle.receive(recorded.message, now_ns)


def chooses_navigator(request: Message) -> bool:
    """Return whether a request selects the navigator or its side."""
    if isinstance(request, ParamSet):
        return request.param_id in ("navigator", "side")
    selection = Command.SIDESTEP_SET_NAVIGATOR
    return isinstance(request, CommandRequest) and request.command == selection


def reexecute(
    recorded: RecordedDrive,
    params: Params,
    start: Pose,
    totals: tuple[int, int] = (0, 0),
    *,
    other: bool = False,
) -> ReexecutionResult:
    """Re-execute all ticks, up to the first with missing inputs, and compare the outputs.

    With `other` only wheel commands are compared, and the run continues after the first difference.
    `totals` are the encoder counters at the start pose. Raises UserError when the robot had moved
    before the recording begins.
    """
    robot = Reexecution(recorded, params, start, totals, other=other)
    result = ReexecutionResult(len(recorded.ticks))
    kinds = COMPARED[:1] if other else COMPARED
    for place, (inputs, sequence) in enumerate(recorded.ticks):
        result.lack = recorded.lack(place)
        if result.lack:
            break
        now = robot.messages(robot.step(inputs), inputs)
        result.compared += 1
        if not place:
            refuse_if_moved(recorded.output(PlanarOdometry, inputs, sequence), now[2])
        before = [recorded.output(kind, inputs, sequence) for kind in kinds]
        result.unrecorded += None in before
        found = first_difference(inputs, before, now)
        if found is None:
            continue
        result.differing += 1
        result.first = result.first or found
        if not other:
            break
    else:
        result.lack = recorded.ends
    return result


def first_difference(
    inputs: TickInputs, before: Sequence[Message | None], now: Sequence[Message]
) -> Difference | None:
    """Return the first difference in the outputs of a tick; skip those not recorded."""
    for recorded, published in zip(before, now, strict=False):
        found = None if recorded is None else difference_of(inputs, recorded, published)
        if found is not None:
            return found
    return None


def difference_of(inputs: TickInputs, recorded: Message, now: Message) -> Difference | None:
    """Return the first field that differs on the wire."""
    names = [name for name in now.__struct_fields__ if name not in UNCOMPARED]
    found = differing_field(recorded, now, names)
    if found is None:
        return None
    return Difference(inputs.tick, inputs.time_ns / NS_PER_S, type(now).__name__, *found)


def differing_field(
    recorded: Message, now: Message, names: Iterable[str]
) -> tuple[str, float, float] | None:
    """Return name, recorded and new value of the first of these fields that differs on the wire."""
    wire = wire_of(type(now))
    arrived = wire.unpack(wire.pack(now))
    for name in names:
        before, after = getattr(recorded, name), getattr(arrived, name)
        if before != after and not (before != before and after != after):
            return name, before, after
    return None


def refuse_unless_whole(recorded: RecordedDrive) -> None:
    """Raise UserError unless the recording begins before the first request or movement."""
    if not recorded.ticks:
        fix = "record with `sidestep rec start` or `up --record` of this version"
        raise UserError(f"{REFUSED}: it holds no inputs of control ticks; {fix}")
    first, sequence = recorded.ticks[0]
    if first.requests > recorded.prepared and (first.tick or sequence):
        requests = f"{first.requests} requests" if first.requests > 1 else "a request"
        why = f"it begins after {requests} to the robot, whose effect is not recorded"
        raise UserError(f"{REFUSED}: {why}; record from the robot's start")


def refuse_if_moved(before: Message | None, fresh: Message) -> None:
    """Raise UserError when the first covariance is not that of a robot that has just started."""
    found = before and differing_field(before, fresh, ("cov_xx_m2", "cov_yy_m2", "cov_hh_rad2"))
    if found:
        why = "it begins after the robot has moved, and the state from before is not recorded"
        raise UserError(f"{REFUSED}: {why}; record from the robot's start")
