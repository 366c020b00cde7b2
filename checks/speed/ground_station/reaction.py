"""Latency from a key in the terminal to the robot's reaction, as an observer on its bus sees it.

A hold has acted when the robot's mode is HOLD: from that tick on its wheels slow down as fast as
permitted. An e-stop has acted when the wheels are commanded to zero.
"""

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from math import hypot
from random import Random
from threading import Event
from typing import Final, TypeVar

from checks.harness.observer import PATIENCE_S, Observer, apart_m
from checks.harness.terminal import Terminal
from checks.harness.until import until
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import GroundTruth, NavigatorStatus, WheelCommand

M = TypeVar("M", bound=Message)
PERIOD_S: Final = 0.05
"""Keys are pressed at random phases of it, as the observer is in step with the robot."""
MIN_DRIVING_M_S: Final = 0.28
MAX_STILL_M_S: Final = 0.003
AGAIN_S: Final = 2.0
SETTLES_S: Final = 0.2
"""Time for the app to receive the reply: it sends one request at a time."""
ATTEMPTS: Final = 20
PLACES: Final = ((5.2, 2.4), (0.8, 1.6))
"""Distant goals in the open world."""


@dataclass(slots=True)
class Presses:
    """Results per key press: time to reaction and to wheels at zero (ms), distance rolled (m)."""

    acted_ms: list[float] = field(default_factory=list)
    wheels_ms: list[float] = field(default_factory=list)
    rolled_m: list[float] = field(default_factory=list)


class TerminalOperator:
    """Type keys as an operator and observe the reaction."""

    def __init__(self, terminal: Terminal, observer: Observer) -> None:
        self._terminal, self._observer = terminal, observer
        self._random = Random(1)

    def presses(self, key: str, release: Callable[[], None], times: int) -> Presses:
        """Press a key while the robot drives, then release it; repeat."""
        found = Presses()
        for _ in range(times):
            self.drive()
            Event().wait(self._random.uniform(0.0, PERIOD_S))
            at_ns = self._terminal.type(key)
            self._note(found, at_ns, stopped if key == " " else held)
            release()
        return found

    def resume(self) -> None:
        """Resume; if the goal was just reached, `drive` gives another one."""
        self._terminal.type("r")
        with suppress(RuntimeError):
            self._until(lambda status: status.mode == Mode.GUIDED, "resumed", AGAIN_S)

    def clear(self) -> None:
        """Clear the e-stop."""
        self._terminal.type("DD")
        self._until(lambda status: status.vehicle == Vehicle.STANDBY, "e-stop cleared", PATIENCE_S)
        Event().wait(SETTLES_S)

    def drive(self) -> None:
        """Drive at full speed; give another goal after one that has ended."""
        for _ in range(ATTEMPTS):
            if self._observer.status.vehicle == Vehicle.FAILSAFE:
                self._leave_failsafe()
            if not self._observer.on_its_way:
                x_m, y_m = self._farthest()
                self._terminal.type(f":goal {x_m:g} {y_m:g}\r")
            elif self._observer.status.mode == Mode.HOLD:
                self._terminal.type("r")
            with suppress(RuntimeError):
                until(self._fast, "driving", AGAIN_S)
                return
        raise RuntimeError(f"the robot does not drive: {self._terminal.text()[-500:]!r}")

    def _farthest(self) -> tuple[float, float]:
        """Return the farther place: a robot that stopped on its way there need not turn round."""
        truth = self._observer.truths[-1][0]
        return max(PLACES, key=lambda place: hypot(place[0] - truth.x_m, place[1] - truth.y_m))

    def _leave_failsafe(self) -> None:
        """Disarm after a failsafe: a busy machine may delay samples past their limit."""
        self._terminal.type("A")
        with suppress(RuntimeError):
            self._until(lambda status: status.vehicle == Vehicle.STANDBY, "disarmed", AGAIN_S)

    def _fast(self) -> bool:
        return self._observer.speed_m_s > MIN_DRIVING_M_S

    def _until(
        self, condition: Callable[[NavigatorStatus], bool], what: str, within_s: float
    ) -> None:
        until(lambda: condition(self._observer.status), what, within_s)

    def _note(self, found: Presses, at_ns: int, acted: Callable[[Message], bool]) -> None:
        seen = self._observer
        until(lambda: first(seen.wheels, at_ns, stopped), "wheels commanded to zero")
        until(lambda: first(seen.truths, at_ns, still), "at rest")
        acts = first([*seen.statuses, *seen.wheels], at_ns, acted)
        wheels = first(seen.wheels, at_ns, stopped)
        before = [truth for truth, arrived_ns in tuple(seen.truths) if arrived_ns <= at_ns][-1]
        after = seen.truths[-1][0]
        assert acts is not None
        assert wheels is not None
        found.acted_ms.append((acts - at_ns) / 1e6)
        found.wheels_ms.append((wheels - at_ns) / 1e6)
        found.rolled_m.append(apart_m(before, after))


def first(
    seen: Iterable[tuple[Message, int]], after_ns: int, condition: Callable[[Message], bool]
) -> int | None:
    """Return when the first such message after a moment arrived."""
    arrivals = [at_ns for message, at_ns in tuple(seen) if at_ns > after_ns and condition(message)]
    return min(arrivals, default=None)


def held(message: Message) -> bool:
    """Return whether the robot reports HOLD."""
    return isinstance(message, NavigatorStatus) and message.mode == Mode.HOLD


def stopped(message: Message) -> bool:
    """Return whether the wheels are commanded to zero."""
    return isinstance(message, WheelCommand) and not (message.left_mrad_s or message.right_mrad_s)


def still(message: Message) -> bool:
    """Return whether the robot is at rest."""
    return isinstance(message, GroundTruth) and abs(message.speed_m_s) < MAX_STILL_M_S
