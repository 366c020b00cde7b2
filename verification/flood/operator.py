"""The operator of a robot under attack: holds the lease, keeps it driving, presses the stop."""

from collections.abc import Sequence
from contextlib import suppress
from itertools import cycle
from math import nan
from threading import Event
from time import monotonic, monotonic_ns
from typing import Final, NamedTuple

from ground.client.emergency_stop import EmergencyStop
from ground.client.requests import RequestIds
from protocol.topics import COMMAND, LEASE_SERVICE, OPERATOR, STOP, TELEOP
from protocol.wire.enums import Command, GoalState, LeaseAction, Mode, Vehicle
from protocol.wire.goal import wire_goal
from protocol.wire.messages import CommandRequest, GoalRequest, LeaseRequest
from protocol.wire.reasons import reason_text
from runtime.clock import WallClock
from runtime.errors import NoAnswer
from runtime.units import NS_PER_S
from verification.flood.presses import BEAT
from verification.harness.motion import HOLDS, PERIOD_S, Seen, stood_s
from verification.harness.observer import Observer

BEAT_S: Final = 0.2
PRESS_S: Final = 10.0
AGAIN_S: Final = 0.25
FAST_M_S: Final = 0.2
SETS_OFF_S: Final = 20.0
STANDS_S: Final = 1.0
"""A robot that moves so long after its stop was acknowledged has not stopped."""

RECENT: Final = 40
"""Truths whose least delay tells the plant's clock from ours."""


class Pressed(NamedTuple):
    """One emergency stop: until the wheels stood, and until it was acknowledged. None: never.

    `seen_ms` is how far the plant has told how it moved.
    """

    stood_ms: float | None
    acknowledged_ms: float | None
    seen_ms: float

    @property
    def was_none(self) -> bool:
        """Return whether it was acknowledged although the robot did not stop."""
        if self.acknowledged_ms is None:
            return False
        over_ms = self.acknowledged_ms + STANDS_S * 1e3
        return self.seen_ms > over_ms and (self.stood_ms is None or self.stood_ms > over_ms)


class Operator:
    """Goes to and fro between the start of the world and its goal.

    After a stop it goes on to the same end, as turning round would take most of the time; it turns
    round after a failsafe, such as contact with a tree.
    """

    def __init__(self, observer: Observer) -> None:
        self.stopped: list[str] = []
        """Why it was seen standing though nobody had stopped it."""
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

    def take(self) -> None:
        self._observer.ask(
            LEASE_SERVICE,
            lambda n: LeaseRequest(request_id=n, action=LeaseAction.TAKE, name="anna"),
        )

    def set_off(self) -> None:
        """Be on the way to the other end of the world, well under way.

        A stop of others may still have been on its way when the last one was cleared.
        """
        deadline_s = monotonic() + SETS_OFF_S
        while not (self._observer.on_its_way and self._observer.speed_m_s > FAST_M_S):
            if monotonic() > deadline_s:
                raise RuntimeError(f"the robot does not drive: {self._observer.status}")
            self.clear()
            self.go_on()
            self._pause.wait(0.02)

    def go_on(self) -> None:
        """Order a goal, unless the robot is on its way to one."""
        self.beat()
        if not self._observer.on_its_way:
            status = self._observer.status
            ended = status.goal in (GoalState.REACHED, GoalState.STUCK)
            if ended or status.vehicle == Vehicle.FAILSAFE:
                self._place = next(self._places)
            place = wire_goal(*self._place, None, 0.1, 0.1)._asdict()
            self.order(Command.COMPONENT_ARM_DISARM, 1.0)
            goal = GoalRequest(request_id=self._ids.next(), mode=Mode.GUIDED, **place)
            self._ask(goal)

    def drive(self, seconds: float) -> None:
        """Keep it driving for so long; what stopped it is noted, and it sets off again."""
        until_s = monotonic() + seconds
        while monotonic() < until_s:
            self._pause.wait(BEAT_S)
            self._note()
            self.go_on()

    def wait(self, seconds: float) -> None:
        """Only show that somebody is there."""
        until_s = monotonic() + seconds
        while monotonic() < until_s:
            self.beat()
            self._pause.wait(BEAT_S)

    def press(self) -> Pressed:
        """Press the stop as the app does, and wait until the wheels stand."""
        self._note()
        robot, statuses = self._observer.robot, self._observer.statuses
        pressed_ns = monotonic_ns()
        stop = EmergencyStop(self._bus, self._stop, robot, WallClock(), lambda: statuses[-1])
        outcome = stop.run(self.beat, round(PRESS_S * NS_PER_S))
        enough_s = outcome.took_ns / NS_PER_S + STANDS_S + HOLDS * PERIOD_S
        until_s = monotonic() + PRESS_S
        seen = self._seen(pressed_ns)
        while stood_s(seen) is None and seen_s(seen) <= enough_s and monotonic() < until_s:
            self.beat()
            self._pause.wait(PERIOD_S)
            seen = self._seen(pressed_ns)
        found = stood_s(seen)
        return Pressed(
            None if found is None else found * 1e3,
            outcome.took_ns / 1e6 if outcome.acknowledged else None,
            seen_s(seen) * 1e3,
        )

    def clear(self) -> None:
        """Have the robot armable again."""
        deadline_s = monotonic() + PRESS_S
        while self._observer.status.vehicle == Vehicle.EMERGENCY_STOP:
            if monotonic() > deadline_s:
                raise RuntimeError("the emergency stop cannot be cleared")
            self.order(Command.SIDESTEP_CLEAR_EMERGENCY_STOP)
            self._pause.wait(PERIOD_S)

    def order(self, command: Command, param1: float = 0.0) -> None:
        self._ask(
            CommandRequest(request_id=self._ids.next(), param1=param1, param2=nan, command=command)
        )

    def beat(self) -> bool:
        """Send a heartbeat when one is due; it never has a stop given up."""
        if monotonic() >= self._beaten_s + BEAT_S:
            self._beaten_s = monotonic()
            self._beat.put(BEAT)
        return False

    def _note(self) -> None:
        status = self._observer.status
        if status.vehicle != Vehicle.ACTIVE:
            why = reason_text(status.vehicle_reason)
            self.stopped.append(f"{Vehicle(status.vehicle).name} {why}")

    def _seen(self, pressed_ns: int) -> list[Seen]:
        """Return how it moved since, by the plant's stamps: none is late on its way."""
        truths = tuple(self._observer.truths)
        early = [(m, at_ns) for m, at_ns in truths if at_ns < pressed_ns][-RECENT:]
        offset_ns = min(at_ns - message.time_ns for message, at_ns in early)
        seen = [Seen((m.time_ns + offset_ns - pressed_ns) / NS_PER_S, m) for m, _ in truths]
        return [one for one in seen if one.at_s > 0.0]

    def _ask(self, request: CommandRequest | GoalRequest) -> None:
        self.beat()
        with suppress(NoAnswer):
            self._bus.ask(COMMAND, request, AGAIN_S, self._observer.robot)


def seen_s(seen: Sequence[Seen]) -> float:
    """Return how far the plant has told how it moved."""
    return seen[-1].at_s if seen else 0.0
