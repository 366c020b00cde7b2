"""The last word on the wheels: which wheel commands are obeyed, and for how long."""

import threading
from typing import Final, NamedTuple

from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.messages import WheelCommand
from runtime.timing import CONTROL_HZ, PERIOD_MS, UINT32

MAX_AGE_TICKS: Final = MAX_WHEEL_TTL_MS // PERIOD_MS
WINDOW: Final = MAX_AGE_TICKS + 1
"""Greatest age, in ticks, of a tick that a command may answer."""

HELD_TICKS: Final = MAX_AGE_TICKS
"""The wheels are held for so long after a contradiction."""

SILENT_TICKS: Final = round(CONTROL_HZ)
"""A newer robot that has been silent for this second no longer keeps an older one out."""


STAND: Final = (0, 0, 0)
"""No speeds, which ended at tick 0."""


class Demand(NamedTuple):
    """Wheel speeds for the motor driver, and for how long from now on. Without time it brakes."""

    left_mrad_s: int
    right_mrad_s: int
    ttl_ms: int


class Heard(NamedTuple):
    """The newest robot: its epoch, the tick of its last command, and that command."""

    epoch: int
    at: int
    tick: int
    seq: int


class CommandGate:
    """Admits commands that answer one of the newest ticks which the plant has really sent.

    A command counts for at most MAX_WHEEL_TTL_MS from the tick that it answers, whatever it
    says itself. A brake, which has no speed or no time to live, is obeyed whatever its numbers are.
    When a brake and a move answer the same tick, another process commands the wheels besides the
    robot: they are held, and for as long as that goes on. Of two robots of one name the one started
    last drives.

    `receive` may be called from any thread.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._ticks = range(0)
        """All that were sent, counted without wrapping."""
        self._heard: Heard | None = None
        self._braked: list[int | None] = [None] * WINDOW
        self._moved: list[int | None] = [None] * WINDOW
        """The ticks that were answered so, each at its place in the window."""
        self._held: range = range(0)
        self._pending: tuple[int, int, int] | None = None
        """Speeds, and when they end in ms since tick 0."""

    def begin_tick(self, tick: int) -> None:
        """Take note that the plant sends this tick."""
        with self._lock:
            self._ticks = range(self._ticks.start if self._ticks else tick, tick + 1)

    @property
    def answered(self) -> bool:
        """Return whether the robot has answered the newest tick."""
        heard, ticks = self._heard, self._ticks
        return heard is not None and heard.tick == ticks[-1]

    def receive(self, command: WheelCommand) -> str:
        """Take a command, or leave it; return what is wrong with one that no robot sends here.

        One that is only late or was overtaken is left without a word.
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

    def take(self) -> Demand | None:
        """Return what is new for the motor driver since the last call."""
        with self._lock:
            pending, self._pending = self._pending, None
            if pending is None:
                return None
            left_mrad_s, right_mrad_s, ends_ms = pending
            return Demand(left_mrad_s, right_mrad_s, max(0, ends_ms - self._ticks[-1] * PERIOD_MS))

    def _brake(self, command: WheelCommand, tick: int | None) -> None:
        """Obey a brake; `tick` is what it answers, None when that does not count any more."""
        self._pending = STAND
        if tick is None:
            tick = self._ticks[-1]
        else:
            self._pending = (0, 0, ends_ms(command, tick))
            if not self._is_fenced_off(command):
                self._heed(command, tick)
        self._braked[tick % WINDOW] = tick
        if self._moved[tick % WINDOW] == tick:
            self._hold()

    def _move(self, command: WheelCommand, tick: int) -> str:
        if self._is_fenced_off(command):
            return "is of a robot that was started before the one that drives"
        is_newest = self._heed(command, tick)
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
        self._pending = STAND

    def _is_fenced_off(self, command: WheelCommand) -> bool:
        """Return whether a robot that was started later lives."""
        heard = self._heard
        if heard is None or command.epoch >= heard.epoch:
            return False
        return self._ticks[-1] - heard.at < SILENT_TICKS

    def _heed(self, command: WheelCommand, tick: int) -> bool:
        """Go on with the robot that sent a command; return whether it is its newest."""
        heard, number = self._heard, (tick, command.seq)
        if heard is not None and heard.epoch == command.epoch and number <= heard[2:]:
            self._heard = heard._replace(at=self._ticks[-1])
            return False
        self._heard = Heard(command.epoch, self._ticks[-1], *number)
        return True


def is_brake(command: WheelCommand) -> bool:
    """Return whether a command stops the wheels: without speed, or without time to live."""
    return command.ttl_ms == 0 or command.left_mrad_s == command.right_mrad_s == 0


def ends_ms(command: WheelCommand, tick: int) -> int:
    """Return when a command that answers this tick ends, in ms since tick 0."""
    return tick * PERIOD_MS + min(command.ttl_ms, MAX_WHEEL_TTL_MS)
