"""Read from a recording the inputs of each control tick and the outputs that followed."""

from collections.abc import Mapping
from itertools import count, takewhile
from typing import Final, NamedTuple

from ground.recording.log_reader import Log
from protocol.topics import ANSWERED, COMMANDED, INPUTS
from protocol.wire.codec import Frame, decode
from protocol.wire.enums import INPUT_SCAN, INPUT_TELEOP, INPUT_WHEELS
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CommandAck,
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
from robot.commands import is_stop
from robot.core.machine import Machine
from runtime.errors import RemoteError
from runtime.sequence import MAX_LATE_TICKS, Order, order_of

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
        return isinstance(request.message, PREPARES) or is_stop(request.message)

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
