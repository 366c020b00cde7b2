"""The operator of a robot under attack: holds the lease, drives and presses the stop."""

import os
import subprocess
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from itertools import cycle
from threading import Event
from time import monotonic, monotonic_ns
from typing import Final, NamedTuple

from checks.harness.bus_calls import OPERATOR_BEAT, arm_request, command_request
from checks.harness.motion import HOLDS, PERIOD_S, Seen, stood_s
from checks.harness.observer import Observer
from ground.client import stop_ways
from ground.client.emergency_stop import EmergencyStop
from ground.client.requests import RequestIds
from ground.launch.child_command import command
from protocol.outcome import wire_goal
from protocol.topics import COMMAND, LEASE_SERVICE, OPERATOR, STOP, TELEOP
from protocol.wire.enums import Command, GoalState, LeaseAction, Mode, Vehicle
from protocol.wire.messages import CommandRequest, GoalRequest, LeaseRequest
from protocol.wire.reasons import reason_text
from runtime.clock import WallClock
from runtime.errors import NoAnswerError
from runtime.units import NS_PER_S

BEAT_S: Final = 0.2
PRESS_S: Final = 10.0
AGAIN_S: Final = 0.25
FAST_M_S: Final = 0.2
SETS_OFF_S: Final = 20.0
STANDS_S: Final = 1.0
"""A robot that still moves this long after the acknowledgement has not stopped."""

RECENT: Final = 40
"""Samples whose least delay gives the offset of the plant's clock."""


class StopTimes(NamedTuple):
    """The times from a key press until the wheels stopped and until the acknowledgement.

    None means never. `seen_ms` is the time of the newest sample of the robot's motion.
    """

    stood_ms: float | None
    acknowledged_ms: float | None
    seen_ms: float

    @property
    def is_false_acknowledgement(self) -> bool:
        """True if the stop was acknowledged although the robot did not stop."""
        if self.acknowledged_ms is None:
            return False
        over_ms = self.acknowledged_ms + STANDS_S * 1e3
        return self.seen_ms > over_ms and (self.stood_ms is None or self.stood_ms > over_ms)


class DrivingOperator:
    """Drives the robot to and fro between the start of the world and its goal.

    After an emergency stop the robot continues to the same end, because turning takes long. After
    a failsafe, such as contact with a tree, it drives to the other end.
    """

    def __init__(self, observer: Observer) -> None:
        self.stopped: list[str] = []
        """The reasons of stops that the operator did not command."""
        self._observer, self._bus = observer, observer.bus
        self._beat = observer.bus.publisher(OPERATOR, observer.robot)
        self._stop = observer.bus.publisher(STOP, observer.robot)
        self._handle = observer.bus.publisher(TELEOP, observer.robot)
        self._bus.await_matched([self._beat, self._stop, self._handle], PRESS_S)
        start, goal = observer.world.start, observer.world.goal
        self._places = cycle([(goal.x_m, goal.y_m), (start.x_m, start.y_m)])
        self._place = next(self._places)
        self._ids = RequestIds()
        self._beaten_s = 0.0
        self._pause = Event()

    def take_lease(self) -> None:
        """Take the lease."""
        self._observer.ask(
            LEASE_SERVICE,
            lambda n: LeaseRequest(request_id=n, action=LeaseAction.TAKE, name="anna"),
        )

    def set_off(self) -> None:
        """Command a goal until the robot drives fast.

        Clear the emergency stop repeatedly: a stop of an attacker may arrive after the last
        clearing.
        """
        deadline_s = monotonic() + SETS_OFF_S
        while not (self._observer.on_its_way and self._observer.speed_m_s > FAST_M_S):
            if monotonic() > deadline_s:
                raise RuntimeError(f"the robot does not drive: {self._observer.status}")
            self.clear()
            self.go_on()
            self._pause.wait(0.02)

    def go_on(self) -> None:
        """Send a goal unless the robot drives to one."""
        self.send_heartbeat()
        if not self._observer.on_its_way:
            status = self._observer.status
            ended = status.goal in (GoalState.REACHED, GoalState.STUCK)
            if ended or status.vehicle == Vehicle.FAILSAFE:
                self._place = next(self._places)
            place = wire_goal(*self._place, None, 0.1, 0.1)._asdict()
            self._ask(arm_request(self._ids.next()))
            self._ask(GoalRequest(request_id=self._ids.next(), mode=Mode.GUIDED, **place))

    def drive(self, seconds: float) -> None:
        """Keep the robot driving for a time; note why it stopped, and set off again."""
        until_s = monotonic() + seconds
        while monotonic() < until_s:
            self._pause.wait(BEAT_S)
            self.note()
            self.go_on()

    def wait(self, seconds: float) -> None:
        """Send only heartbeats for a time."""
        until_s = monotonic() + seconds
        while monotonic() < until_s:
            self.send_heartbeat()
            self._pause.wait(BEAT_S)

    def press(self) -> StopTimes:
        """Press the stop as the app does, and wait until the robot is at rest."""
        self.note()
        robot, statuses = self._observer.robot, self._observer.statuses
        pressed_ns = monotonic_ns()
        with closing(stop_ways.ways_of(self._bus, robot)) as ways:
            stop = EmergencyStop(
                self._bus, self._stop, robot, WallClock(), lambda: statuses[-1], ways
            )
            outcome = stop.run(self.send_heartbeat, round(PRESS_S * NS_PER_S))
        return self._times(pressed_ns, outcome.took_ns, is_acknowledged=outcome.acknowledged)

    def press_elsewhere(
        self, key: Callable[[], int], acknowledged: Callable[[], bool]
    ) -> StopTimes:
        """Press a key of another program; wait until it shows the end and the robot is at rest.

        `key` returns when it was pressed.
        """
        self.note()
        pressed_ns = key()
        until_ns = pressed_ns + round(PRESS_S * NS_PER_S)
        while not (shown := acknowledged()) and monotonic_ns() < until_ns:
            self.send_heartbeat()
            self._pause.wait(PERIOD_S / 10)
        return self._times(pressed_ns, monotonic_ns() - pressed_ns, is_acknowledged=shown)

    def press_freshly(self, words: Sequence[str]) -> StopTimes:
        """Stop by an `estop` that is started now, and wait until the robot is at rest."""
        self.note()
        started_ns = monotonic_ns()
        with subprocess.Popen(
            command(("estop", *words), os.getpid()),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as process:
            while process.poll() is None:
                self.send_heartbeat()
                self._pause.wait(PERIOD_S / 10)
        took_ns = monotonic_ns() - started_ns
        return self._times(started_ns, took_ns, is_acknowledged=process.returncode == 0)

    def _times(self, pressed_ns: int, took_ns: int, *, is_acknowledged: bool) -> StopTimes:
        """Wait until the robot is at rest after a stop that took so long."""
        enough_s = took_ns / NS_PER_S + STANDS_S + HOLDS * PERIOD_S
        until_s = monotonic() + PRESS_S
        seen = self._seen(pressed_ns)
        while stood_s(seen) is None and seen_s(seen) <= enough_s and monotonic() < until_s:
            self.send_heartbeat()
            self._pause.wait(PERIOD_S)
            seen = self._seen(pressed_ns)
        found = stood_s(seen)
        return StopTimes(
            None if found is None else found * 1e3,
            took_ns / 1e6 if is_acknowledged else None,
            seen_s(seen) * 1e3,
        )

    def clear(self) -> None:
        """Clear the emergency stop; RuntimeError when the robot stays in it."""
        deadline_s = monotonic() + PRESS_S
        while self._observer.status.vehicle == Vehicle.EMERGENCY_STOP:
            if monotonic() > deadline_s:
                raise RuntimeError("the emergency stop cannot be cleared")
            clear, stop_id = Command.SIDESTEP_CLEAR_EMERGENCY_STOP, self._observer.status.stop_id
            self._ask(command_request(self._ids.next(), clear, stop_id=stop_id))
            self._pause.wait(PERIOD_S)

    def send_heartbeat(self) -> bool:
        """Send a heartbeat if one is due; return False, so that a stop is never given up."""
        if monotonic() >= self._beaten_s + BEAT_S:
            self._beaten_s = monotonic()
            self._beat.put(OPERATOR_BEAT)
        return False

    def note(self) -> None:
        """Note why the robot has stopped, if it has."""
        status = self._observer.status
        if status.vehicle != Vehicle.ACTIVE:
            why = reason_text(status.vehicle_reason)
            self.stopped.append(f"{Vehicle(status.vehicle).name} {why}")

    def _seen(self, pressed_ns: int) -> list[Seen]:
        """Return the motion since the press, by the plant's time stamps, free of network delays."""
        truths = tuple(self._observer.truths)
        early = [(m, at_ns) for m, at_ns in truths if at_ns < pressed_ns][-RECENT:]
        offset_ns = min(at_ns - message.time_ns for message, at_ns in early)
        seen = [Seen((m.time_ns + offset_ns - pressed_ns) / NS_PER_S, m) for m, _ in truths]
        return [one for one in seen if one.at_s > 0.0]

    def _ask(self, request: CommandRequest | GoalRequest) -> None:
        self.send_heartbeat()
        with suppress(NoAnswerError):
            self._bus.ask(COMMAND, request, AGAIN_S, self._observer.robot)


def seen_s(seen: Sequence[Seen]) -> float:
    """Return the time of the newest sample of the robot's motion."""
    return seen[-1].at_s if seen else 0.0
