"""What a recording holds of the control loop: what each tick was given, and what came of it."""

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
from runtime.errors import RemoteError
from runtime.sequence import MAX_LATE_TICKS, Order, order_of

BYTE: Final = 0xFF

PREPARES: Final = (
    *(MissionCount, MissionItemInt, MissionClearAll, MissionRequestList, MissionRequestInt),
    *(ParamRequestRead, ParamSet),
)
"""Requests that change no more than what a robot begins with, whenever they come before it moves:
as those by which one that starts has its fence and its mission again."""

IGNORED: Final = (
    Reason.LEASE_HELD,
    Reason.FENCE_LEAVES_ROBOT_OUT,
    Reason.LESS_SAFE_THAN_CONFIGURED,
)
"""Refused for what an execution does not know, or knows only later."""

OUTPUTS: Final = (WheelCommand, AvoidanceDecision, PlanarOdometry, NavigatorStatus)

Key = tuple[int, int]
"""Stamp and MAVLink sequence: all frames of one tick have the same."""


class RecordedRequest(NamedTuple):
    """What was asked, and whether the robot acted on it."""

    message: Message
    acted_on: bool


class RecordedDrive:
    """One recording. `ticks` are in order; a lack of anything is found when it is asked for."""

    def __init__(self, log: Log) -> None:
        self.facts: Mapping[str, str] = log.facts
        self.ticks: list[tuple[TickInputs, int]] = []
        """What each tick was given, and its frame's sequence."""
        self.ends = ""
        """Why it cannot go on behind the last of them; empty when there is no more."""
        self._wheels: dict[int, WheelTicks] = {}
        self._scans: dict[int, SonarScan] = {}
        self.fence_lost = False
        """The robot had a fence that it could not read, which no request tells."""
        self._outputs: dict[tuple[type[Message], Key], Message] = {}
        self._asked: list[tuple[int, Message]] = []
        self._answers: list[tuple[int, Message]] = []
        for one in log:
            if self.ends:
                continue  # to its end, where the log knows what it has lost
            try:
                self._take(one.key, decode(one.frame))
            except RemoteError:
                continue
        self.robot = log.robot
        self.damage = log.damage()
        self.requests = self._paired()
        self.prepared = len(list(takewhile(self._prepares, count(1))))
        """So many requests, from the first on, only prepare it."""
        del self.ticks[: self._beginning()]

    def _take(self, key: str, frame: Frame) -> None:
        message, sequence = frame.message, frame.sequence
        if isinstance(message, WheelTicks):
            self._wheels.setdefault(message.seq, message)
        elif isinstance(message, SonarScan):
            self._scans.setdefault(message.seq, message)
        elif isinstance(message, TickInputs) and key.endswith(INPUTS.path):
            if self.ticks and begun_anew(self.ticks[-1][0], message):
                self.ends = "the rest: robot or plant was started again"
            else:
                self.ticks.append((message, sequence))
        elif isinstance(message, OUTPUTS):
            self._outputs.setdefault((type(message), (message.time_ns, sequence)), message)
            if isinstance(message, NavigatorStatus):
                self.fence_lost |= message.vehicle_reason == Reason.FENCE_UNREADABLE
        elif key.endswith(COMMANDED.path):
            self._asked.append((sequence, message))
        elif key.endswith(ANSWERED.path):
            self._answers.append((sequence, message))

    def _paired(self) -> dict[int, RecordedRequest]:
        """Requests by their number from 1, which is what the sequence of their frames counts."""
        answers = dict(_unwrapped(self._answers))
        return {
            place + 1: RecordedRequest(message, reason_in(answers.get(place)) not in IGNORED)
            for place, message in _unwrapped(self._asked)
        }

    def _beginning(self) -> int:
        """The first tick from which on all is there, while the robot has nothing to do.

        A recorder may hear the robot before it hears the plant; nothing is lost with that.
        """
        idle = len(list(takewhile(self._at_rest, self.ticks)))
        after = max((place + 1 for place in range(idle) if self.lack(place)), default=0)
        return after if after < idle else 0

    def _prepares(self, number: int) -> bool:
        request = self.requests.get(number)
        return request is not None and isinstance(request.message, PREPARES)

    def _at_rest(self, tick: tuple[TickInputs, int]) -> bool:
        """Nobody had asked the robot to do anything, or steered it."""
        inputs, _ = tick
        return inputs.requests <= self.prepared and not inputs.flags & INPUT_TELEOP

    def output(self, kind: type[Message], inputs: TickInputs, sequence: int) -> Message | None:
        """What came of a tick; None when it is not in the recording."""
        return self._outputs.get((kind, (inputs.time_ns, sequence)))

    def senses(self, inputs: TickInputs) -> tuple[WheelTicks | None, SonarScan | None]:
        """What was sensed in a tick; None also for what was stale or had not come."""
        there = inputs.flags & INPUT_WHEELS
        wheels = self._wheels.get(inputs.wheels_seq) if there else None
        scan = self._scans.get(inputs.scan_seq) if inputs.flags & INPUT_SCAN else None
        return wheels, scan

    def lack(self, place: int) -> str:
        """What of a tick is not in the recording, in words; empty when nothing is missing."""
        inputs, sequence = self.ticks[place]
        before = self.ticks[place - 1] if place else None
        if before is not None and (sequence - before[1]) & BYTE != 1:
            return "the inputs of the tick before it"
        wheels, scan = self.senses(inputs)
        if wheels is None and inputs.flags & INPUT_WHEELS:
            return f"wheel ticks {inputs.wheels_seq}, which it was given"
        if scan is None and inputs.flags & INPUT_SCAN:
            return f"sonar scan {inputs.scan_seq}, which it was given"
        asked_before = before[0].requests if before is not None else 0
        missing = [
            n for n in range(asked_before + 1, inputs.requests + 1) if n not in self.requests
        ]
        return f"request {missing[0]}, which came before it" if missing else ""


def begun_anew(before: TickInputs, now: TickInputs) -> bool:
    """Has its robot or its plant begun to count again?"""
    return now.tick < before.tick or Order.RESTARTED in (
        order_of(now.wheels_seq, before.wheels_seq, MAX_LATE_TICKS),
        order_of(now.scan_seq, before.scan_seq, MAX_LATE_TICKS),
    )


def reason_in(answer: Message | None) -> int:
    if isinstance(answer, CommandAck):
        return answer.result_param2
    return answer.reason if isinstance(answer, MissionVerdict) else Reason.NONE


def _unwrapped(counted: list[tuple[int, Message]]) -> list[tuple[int, Message]]:
    """Sequences of one byte as numbers that go on; no more than 255 in a row may be lost."""
    found: list[tuple[int, Message]] = []
    place = -1
    for sequence, message in counted:
        place += (sequence - place) & BYTE or (BYTE + 1 if found else 0)
        found.append((place, message))
    return found
