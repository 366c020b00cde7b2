"""`sidestep replay FILE --re-execute`: recorded senses, fed to the robot of this build.

The robot is given, tick by tick, exactly what the recorded one was given, and what it makes of it
is compared bit by bit. With another navigator that is an open loop: the senses stay those of the
way that was driven.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from protocol.wire.enums import INPUT_BUDGET, INPUT_NAME_TAKEN, INPUT_TELEOP, Command
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CommandRequest,
    LeaseRequest,
    NavigatorStatus,
    ParamSet,
    PlanarOdometry,
    TickInputs,
    WheelCommand,
)
from protocol.wire.packing import wire_of
from robot import telemetry
from robot.core import modes, reasons
from robot.core.parameters import Params
from robot.core.perception.from_messages import scan_of, twist_of, wheels_of
from robot.core.values import Inputs, Outputs, Pose
from robot.storage.files import Store
from robot.telemetry import NEVER
from robot.vehicle import Vehicle
from runtime.errors import UserError
from runtime.units import NS_PER_MS, NS_PER_S
from study.trial.recorded_drive import RecordedDrive

COMPARED: Final = (WheelCommand, AvoidanceDecision, PlanarOdometry, NavigatorStatus)
UNCOMPARED: Final = frozenset(
    {"seq", "sense_seq", "epoch", "ttl_ms", "goal_started_ns", "goal_ended_ns"}
)
"""Counters, and times of requests, which are told to no tick."""


class Difference(NamedTuple):
    """The first value that is not the same."""

    tick: int
    time_s: float
    message: str
    field: str
    recorded: float
    now: float


@dataclass(slots=True)
class ReexecutionResult:
    """How many ticks were the same, what the first other one was, and why it ended, if early.

    `unheard` ticks were executed, but part of what came of them is not in the recording.
    """

    ticks: int
    compared: int = 0
    differing: int = 0
    unheard: int = 0
    first: Difference | None = None
    lack: str = ""


def ignore(_stage: int) -> None:
    """Nobody takes the time."""


class Reexecution:
    """The robot of this build, driven by a recording."""

    def __init__(
        self, recorded: RecordedDrive, params: Params, start: Pose, *, other: bool
    ) -> None:
        """`other`: with a navigator of its own, so that what chose another one is left out."""
        self._recorded = recorded
        self._other = other
        self._vehicle = Vehicle(params, Store(None), start)
        self._vehicle.tuning.configured = None  # what was refused for it is left out
        if recorded.fence_lost:
            modes.lose_fence(self._vehicle.state.machine)
        self._asked = 0

    def step(self, inputs: TickInputs) -> Outputs:
        """One tick, as `robot.process` does it."""
        now_ns = inputs.now_ms * NS_PER_MS
        for number in range(self._asked + 1, inputs.requests + 1):
            self._ask(number, now_ns)
        self._asked = inputs.requests
        if inputs.flags & INPUT_BUDGET:
            self._vehicle.report(reasons.BUDGET)
        if inputs.flags & INPUT_NAME_TAKEN:
            self._vehicle.report(reasons.NAME_TAKEN)
        steered = inputs.flags & INPUT_TELEOP
        manual = twist_of(inputs.speed_mm_s, inputs.yaw_rate_mrad_s) if steered else None
        return self._vehicle.step(self._inputs(inputs), ignore, manual)

    def said(self, outputs: Outputs, inputs: TickInputs) -> tuple[Message, ...]:
        """What the robot would publish of it, in the order of COMPARED."""
        vehicle, time_ns = self._vehicle, inputs.time_ns
        command = WheelCommand(
            time_ns=time_ns,
            seq=0,
            sense_seq=0,
            left_mrad_s=outputs.left_mrad_s,
            right_mrad_s=outputs.right_mrad_s,
            ttl_ms=0,
        )
        goal_id, stop_id = vehicle.commands.goal_id, vehicle.commands.stop_id
        return (
            command,
            telemetry.decision(outputs, vehicle.zone_m, time_ns),
            telemetry.odometry(vehicle.state, time_ns),
            telemetry.status(vehicle.state, goal_id, time_ns, inputs.now_ms, stop_id),
        )

    def _inputs(self, given: TickInputs) -> Inputs:
        wheels, scan = self._recorded.senses(given)
        age_ms = None if given.operator_age_ms == NEVER else given.operator_age_ms
        return Inputs(
            given.now_ms,
            None if wheels is None else wheels_of(wheels),
            None if scan is None else scan_of(scan, given.scan_age_ms),
            age_ms,
        )

    def _ask(self, number: int, now_ns: int) -> None:
        request = self._recorded.requests[number]
        chooses = self._other and chooses_navigator(request.message)
        if request.acted_on and not isinstance(request.message, LeaseRequest) and not chooses:
            self._vehicle.receive(request.message, now_ns)


def chooses_navigator(request: Message) -> bool:
    if isinstance(request, ParamSet):
        return request.param_id in ("navigator", "side")
    chooses = Command.SIDESTEP_SET_NAVIGATOR
    return isinstance(request, CommandRequest) and request.command == chooses


def reexecute(
    recorded: RecordedDrive, params: Params, start: Pose, *, other: bool = False
) -> ReexecutionResult:
    """Every tick up to the end or to the first one of which something is missing.

    With `other` only wheel commands are compared, and it goes on behind the first difference.
    """
    again = Reexecution(recorded, params, start, other=other)
    verdict = ReexecutionResult(len(recorded.ticks))
    kinds = COMPARED[:1] if other else COMPARED
    for place, (inputs, sequence) in enumerate(recorded.ticks):
        verdict.lack = recorded.lack(place)
        if verdict.lack:
            break
        now = again.said(again.step(inputs), inputs)
        verdict.compared += 1
        if not place:
            refuse_if_moved(recorded.output(PlanarOdometry, inputs, sequence), now[2])
        before = [recorded.output(kind, inputs, sequence) for kind in kinds]
        verdict.unheard += None in before
        found = first_of(inputs, before, now)
        if found is None:
            continue
        verdict.differing += 1
        verdict.first = verdict.first or found
        if not other:
            break
    else:
        verdict.lack = recorded.ends
    return verdict


def first_of(
    inputs: TickInputs, before: Sequence[Message | None], now: Sequence[Message]
) -> Difference | None:
    """The first difference in what a tick said. What was not recorded is not compared."""
    for recorded, said in zip(before, now, strict=False):
        found = None if recorded is None else differs(inputs, recorded, said)
        if found is not None:
            return found
    return None


def differs(inputs: TickInputs, recorded: Message, now: Message) -> Difference | None:
    """The first field that is another one on the wire."""
    names = [name for name in now.__struct_fields__ if name not in UNCOMPARED]
    found = differs_in(recorded, now, names)
    if found is None:
        return None
    return Difference(inputs.tick, inputs.time_ns / NS_PER_S, type(now).__name__, *found)


def differs_in(
    recorded: Message, now: Message, names: Iterable[str]
) -> tuple[str, float, float] | None:
    """Name and both values of the first of these fields that is not the same on the wire."""
    wire = wire_of(type(now))
    arrived = wire.unpack(wire.pack(now))
    for name in names:
        before, after = getattr(recorded, name), getattr(arrived, name)
        if before != after and not (before != before and after != after):
            return name, before, after
    return None


def refuse_unless_whole(recorded: RecordedDrive) -> None:
    """UserError unless it begins before the robot was asked anything or moved."""
    if not recorded.ticks:
        why = "no tick's inputs are in it"
        fix = "record with `sidestep record` or `up --record` of this version"
        raise UserError(f"it cannot be executed again: {why}; {fix}")
    first, sequence = recorded.ticks[0]
    if first.requests > recorded.prepared and (first.tick or sequence):
        asked = f"{first.requests} requests" if first.requests > 1 else "a request"
        why = f"it begins after {asked} to the robot, and what came of that is not in it"
        raise UserError(f"it cannot be executed again: {why}; record from the robot's start")


def refuse_if_moved(before: Message | None, fresh: Message) -> None:
    """UserError when the doubt about the first pose is not that of a robot just started."""
    found = before and differs_in(before, fresh, ("cov_xx_m2", "cov_yy_m2", "cov_hh_rad2"))
    if found:
        why = "the robot had been moved before it begins, and its memory of that is not in it"
        raise UserError(f"it cannot be executed again: {why}; record from the robot's start")
