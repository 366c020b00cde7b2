"""The app on a terminal of a given size, and the latency from a key to the robot's reaction.

An observer on the robot's bus sees the reaction, and the distance rolled. A hold has acted when the
robot's mode is HOLD: from that tick on its wheels slow down as fast as permitted. An e-stop has
acted when the wheels are commanded to zero.
"""

import argparse
import os
import signal
import termios
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from math import hypot
from pathlib import Path
from random import Random
from threading import Event
from typing import Final, TypeVar

from checks.harness.figures import Figure
from checks.harness.observer import PATIENCE_S, Observer, apart_m, observed
from checks.harness.terminal import CHUNK, SLOW_READ_S, Terminal
from checks.harness.until import until
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import GroundTruth, NavigatorStatus, WheelCommand
from runtime.units import PERIOD_MS, PERIOD_S

SIZES: Final = ((80, 24), (140, 40))
READY: Final = "read: ready"
REPLAYING: Final = "REPLAY"
RECORDINGS: Final = Path("sidestep") / "recordings"
APP_PATIENCE_S: Final = 30.0


class AdjustableTerminal(Terminal):
    """A terminal whose size and speed change while the app runs, which is not started again."""

    def resize(self, size: tuple[int, int]) -> None:
        """Set the size in columns and rows, and notify the app as a terminal emulator does."""
        columns, rows = size
        termios.tcsetwinsize(self._end, (rows, columns))
        os.kill(self.pid, signal.SIGWINCH)  # it is not the terminal's controlling process

    @contextmanager
    def slow(self, most_per_s: int) -> Iterator[None]:
        """Read at most so many bytes a second until the block ends."""
        self._pause_s, self._chunk = SLOW_READ_S, max(1, round(most_per_s * SLOW_READ_S))
        try:
            yield
        finally:
            self._pause_s, self._chunk = 0.0, CHUNK


@contextmanager
def on_terminal(
    observer: Observer,
    size: tuple[int, int],
    *,
    bytecode: Path | None = None,
) -> Iterator[AdjustableTerminal]:
    """Start `sidestep ground` with a state folder of its own.

    With `bytecode` compiled modules are kept there, as in an installation.
    """
    words = ("ground", "--id", observer.robot, "--connect", observer.endpoint)
    environment = {"XDG_STATE_HOME": str(observer.folder)}
    if bytecode is not None:
        environment["PYTHONPYCACHEPREFIX"] = str(bytecode)
    with AdjustableTerminal(words, size, environment) as terminal:
        yield terminal


@contextmanager
def commanding(observer: Observer, size: tuple[int, int]) -> Iterator[AdjustableTerminal]:
    """Start the app and wait until it has read all that it needs."""
    with on_terminal(observer, size) as terminal:
        terminal.shown(READY, APP_PATIENCE_S)
        yield terminal


@contextmanager
def replaying(observer: Observer, size: tuple[int, int]) -> Iterator[Terminal]:
    """Show the latest recording without playing it."""
    path = max((observer.folder / RECORDINGS).glob("*.mcap"), key=lambda path: path.stat().st_size)
    environment = {"XDG_STATE_HOME": str(observer.folder)}
    with Terminal(("replay", str(path)), size, environment) as terminal:
        terminal.shown(REPLAYING, APP_PATIENCE_S)
        yield terminal


M = TypeVar("M", bound=Message)
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


WORLD: Final = "open"
SLACK_MS: Final = 5.0
HOLD, ESTOP = "h", " "


def key_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure hold and e-stop."""
    with observed(WORLD) as observer, commanding(observer, SIZES[0]) as terminal:
        operator = TerminalOperator(terminal, observer)
        holds = operator.presses(HOLD, operator.resume, options.presses)
        stops = operator.presses(ESTOP, operator.clear, options.presses)
    notes = [
        "from the write of the key into the pty to what an observer on the bus receives;"
        " one period is 50 ms",
        "hold has acted when the robot reports HOLD: the wheels slow down from that tick on;"
        " e-stop when the wheels are commanded to zero",
        "rolled: true distance from the last sample before the key to rest, at 0.3 m/s",
    ]
    return [*figures_of("hold", holds), *figures_of("e-stop", stops)], notes


def figures_of(name: str, found: Presses) -> list[Figure]:
    """Return the figures of one key."""
    worst_ms = max(found.acted_ms)
    return [
        Figure(
            name=f"{name}: key to robot acts",
            unit="ms",
            values=tuple(found.acted_ms),
            at_most=PERIOD_MS + SLACK_MS,
        ),
        Figure(
            name=f"{name}: key to robot acts, worst",
            unit="ms",
            values=(worst_ms,),
            at_most=2 * PERIOD_MS + SLACK_MS,
        ),
        Figure(name=f"{name}: key to wheels at zero", unit="ms", values=tuple(found.wheels_ms)),
        Figure(name=f"{name}: rolled", unit="m", values=tuple(found.rolled_m)),
    ]
