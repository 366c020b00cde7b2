"""The last word on the wheels: which wheel commands are obeyed, and for how long."""

import threading
from typing import Final, NamedTuple

from protocol.messages import WheelCommand
from protocol.timing import CONTROL_HZ, PERIOD_MS, TTL_MS, UINT32

MAX_AGE_TICKS: Final = TTL_MS // PERIOD_MS
HELD_TICKS: Final = MAX_AGE_TICKS
"""The wheels are held for so long after a contradiction."""

SILENT_TICKS: Final = round(CONTROL_HZ)
"""A newer robot that has been silent for this second no longer keeps an older one out."""


class Demand(NamedTuple):
    """Wheel speeds for the motor driver, and for how long from now on. Without time it brakes."""

    left_mrad_s: int
    right_mrad_s: int
    ttl_ms: int


class CommandGate:
    """Admits commands that answer one of the newest ticks which the plant has really sent.

    A command counts for at most TTL_MS from the tick that it answers, whatever it says itself. A
    brake, which has no speed or no time to live, is obeyed whatever its numbers are. When a brake
    and a move answer the same tick, another process commands the wheels besides the robot: they are
    held, and for as long as that goes on. Of two robots of one name the one started last drives.

    `receive` may be called from any thread.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._first: int | None = None
        self._sent = 0
        self._epoch = -1
        self._heard = 0
        """Tick at which the newest epoch was last heard."""
        self._newest: tuple[int, int] | None = None
        """Tick answered by, and number of, the newest command of the epoch."""
        self._braked: set[int] = set()
        self._moved: set[int] = set()
        self._held_until = 0
        self._pending: tuple[int, int, int] | None = None
        """Speeds, and when they end in ms since tick 0."""

    def begin_tick(self, tick: int) -> None:
        """Take note that the plant sends this tick, counted without wrapping."""
        with self._lock:
            self._first = tick if self._first is None else self._first
            self._sent = tick
            for answered in (self._braked, self._moved):
                answered.difference_update({one for one in answered if not self._counts(one)})

    @property
    def answered(self) -> bool:
        """Whether the robot has answered the newest tick."""
        return self._newest is not None and self._newest[0] == self._sent

    def receive(self, command: WheelCommand) -> str:
        """Take a command, or leave it; return what is wrong with one that no robot sends here.

        One that is only late or was overtaken is left without a word.
        """
        with self._lock:
            if self._first is None:
                return ""
            tick = self._tick_of(command, self._first)
            if is_brake(command):
                self._brake(command, tick)
                return ""
            if tick is None:
                return "answers a tick that was never sent"
            return self._move(command, tick) if self._counts(tick) else ""

    def take(self) -> Demand | None:
        """Return what is new for the motor driver since the last call."""
        with self._lock:
            pending, self._pending = self._pending, None
            if pending is None:
                return None
            left_mrad_s, right_mrad_s, ends_ms = pending
            return Demand(left_mrad_s, right_mrad_s, max(0, ends_ms - self._sent * PERIOD_MS))

    def _tick_of(self, command: WheelCommand, first: int) -> int | None:
        """Return the tick that a command answers; None when the plant has not sent it."""
        tick = self._sent - ((self._sent - command.sense_seq) & UINT32)
        return tick if tick >= first else None

    def _counts(self, tick: int) -> bool:
        return self._sent - tick <= MAX_AGE_TICKS

    def _brake(self, command: WheelCommand, tick: int | None) -> None:
        answered = tick if tick is not None and self._counts(tick) else None
        if answered is not None and not self._fenced_off(command):
            self._heed(command, answered)
        braked = self._sent if answered is None else answered
        self._braked.add(braked)
        self._pending = (0, 0, 0 if answered is None else ends_ms(command, answered))
        if braked in self._moved:
            self._hold()

    def _move(self, command: WheelCommand, tick: int) -> str:
        if self._fenced_off(command):
            return "is of a robot that was started before the one that drives"
        newest = self._newest if command.epoch == self._epoch else None
        self._heed(command, tick)
        self._moved.add(tick)
        if tick in self._braked:
            self._hold()
        if self._sent < self._held_until:
            return "moves the wheels while the robot brakes"
        if newest is None or (tick, command.seq) > newest:
            self._pending = (command.left_mrad_s, command.right_mrad_s, ends_ms(command, tick))
        return ""

    def _hold(self) -> None:
        self._held_until = self._sent + HELD_TICKS
        self._pending = (0, 0, 0)

    def _fenced_off(self, command: WheelCommand) -> bool:
        """Return whether a robot that was started later lives."""
        return command.epoch < self._epoch and self._sent - self._heard < SILENT_TICKS

    def _heed(self, command: WheelCommand, tick: int) -> None:
        """Go on with the epoch of a command; remember the newest command of it."""
        number = (tick, command.seq)
        if command.epoch == self._epoch and self._newest is not None:
            number = max(number, self._newest)
        self._newest = number
        self._epoch, self._heard = command.epoch, self._sent


def is_brake(command: WheelCommand) -> bool:
    """Return whether a command stops the wheels: without speed, or without time to live."""
    return command.ttl_ms == 0 or command.left_mrad_s == command.right_mrad_s == 0


def ends_ms(command: WheelCommand, tick: int) -> int:
    """Return when a command that answers this tick ends, in ms since tick 0."""
    return tick * PERIOD_MS + min(command.ttl_ms, TTL_MS)
