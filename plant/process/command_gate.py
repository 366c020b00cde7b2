"""Last check of wheel commands: which are executed, and for how long."""

import threading
from typing import Final, NamedTuple

from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.messages import WheelCommand
from runtime.timing import CONTROL_HZ, PERIOD_MS, UINT32

MAX_AGE_TICKS: Final = MAX_WHEEL_TTL_MS // PERIOD_MS
WINDOW: Final = MAX_AGE_TICKS + 1
"""Number of newest ticks that a command may answer."""

HELD_TICKS: Final = MAX_AGE_TICKS
"""Ticks for which the wheels stay stopped after a contradiction."""

SILENT_TICKS: Final = round(CONTROL_HZ)
"""Silence of a newer robot, in ticks, after which an older one may drive again: 1 s."""


STOPPED: Final = (0, 0, 0)
"""Output without speed, which ended at tick 0."""


class WheelOutput(NamedTuple):
    """Wheel speeds for the motor driver, and their duration from now on. Duration 0 brakes."""

    left_mrad_s: int
    right_mrad_s: int
    ttl_ms: int


class NewestRobot(NamedTuple):
    """Epoch, tick of the last command and that command of the robot started last."""

    epoch: int
    at: int
    tick: int
    seq: int


class CommandGate:
    """Admit commands that answer one of the newest ticks that the plant has sent.

    A command is valid for at most MAX_WHEEL_TTL_MS from the tick that it answers, whatever its own
    time-to-live. A brake, a command without speed or time-to-live, is executed whatever its
    numbers. If a brake and a move answer the same tick, another process commands the wheels besides
    the robot: the wheels are then stopped for as long as that continues. Of two robots of one name
    the one started last drives.

    `receive` may be called from any thread.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._ticks = range(0)
        """All ticks sent, counted without wrapping."""
        self._newest_robot: NewestRobot | None = None
        self._braked: list[int | None] = [None] * WINDOW
        self._moved: list[int | None] = [None] * WINDOW
        """Ticks answered by a brake or by a move, each at its index in the window."""
        self._held: range = range(0)
        self._pending: tuple[int, int, int] | None = None
        """Speeds, and their end in ms since tick 0."""

    def begin_tick(self, tick: int) -> None:
        """Record that the plant sends this tick."""
        with self._lock:
            self._ticks = range(self._ticks.start if self._ticks else tick, tick + 1)

    @property
    def answered(self) -> bool:
        """Return whether the robot has answered the newest tick."""
        robot, ticks = self._newest_robot, self._ticks
        return robot is not None and robot.tick == ticks[-1]

    def receive(self, command: WheelCommand) -> str:
        """Admit or ignore a command; return what is wrong with one that no valid robot sends.

        A command that is only late or reordered is ignored without an error.
        """
        with self._lock:
            if not self._ticks:
                return ""
            newest = self._ticks[-1]
            tick = newest - ((newest - command.sense_seq) & UINT32)
            counts = tick in self._ticks[-WINDOW:]
            if is_brake(command):
                self._brake(command, tick if counts else None)
            elif counts:
                return self._move(command, tick)
            elif tick not in self._ticks:
                return "answers a tick that was never sent"
            return ""

    def take(self) -> WheelOutput | None:
        """Return the new output for the motor driver; None without a change since the last call."""
        with self._lock:
            pending, self._pending = self._pending, None
            if pending is None:
                return None
            left_mrad_s, right_mrad_s, ends_ms = pending
            left_ms = max(0, ends_ms - self._ticks[-1] * PERIOD_MS)
            return WheelOutput(left_mrad_s, right_mrad_s, left_ms)

    def _brake(self, command: WheelCommand, tick: int | None) -> None:
        """Execute a brake; `tick` is the tick that it answers, None if that is too old."""
        self._pending = STOPPED
        if tick is None:
            tick = self._ticks[-1]
        else:
            self._pending = (0, 0, ends_ms(command, tick))
            if not self._is_fenced_off(command):
                self._follow(command, tick)
        self._braked[tick % WINDOW] = tick
        if self._moved[tick % WINDOW] == tick:
            self._hold()

    def _move(self, command: WheelCommand, tick: int) -> str:
        if self._is_fenced_off(command):
            return "comes from a robot that was started before the active one"
        is_newest = self._follow(command, tick)
        self._moved[tick % WINDOW] = tick
        if self._braked[tick % WINDOW] == tick:
            self._hold()
        if self._ticks[-1] in self._held:
            return "moves the wheels while the robot brakes"
        if is_newest:
            self._pending = (command.left_mrad_s, command.right_mrad_s, ends_ms(command, tick))
        return ""

    def _hold(self) -> None:
        newest = self._ticks[-1]
        self._held = range(newest, newest + HELD_TICKS)
        self._pending = STOPPED

    def _is_fenced_off(self, command: WheelCommand) -> bool:
        """Return whether a robot that was started later is active."""
        robot = self._newest_robot
        if robot is None or command.epoch >= robot.epoch:
            return False
        return self._ticks[-1] - robot.at < SILENT_TICKS

    def _follow(self, command: WheelCommand, tick: int) -> bool:
        """Make the sender of a command the active robot; return whether the command is new."""
        robot, number = self._newest_robot, (tick, command.seq)
        if robot is not None and robot.epoch == command.epoch and number <= robot[2:]:
            self._newest_robot = robot._replace(at=self._ticks[-1])
            return False
        self._newest_robot = NewestRobot(command.epoch, self._ticks[-1], *number)
        return True


def is_brake(command: WheelCommand) -> bool:
    """Return whether a command stops the wheels: without speed or without time-to-live."""
    return command.ttl_ms == 0 or command.left_mrad_s == command.right_mrad_s == 0


def ends_ms(command: WheelCommand, tick: int) -> int:
    """Return when a command that answers this tick ends, in ms since tick 0."""
    return tick * PERIOD_MS + min(command.ttl_ms, MAX_WHEEL_TTL_MS)
