"""Link of the plant to one robot: sensor data and ground truth out, wheel commands in.

A gate decides last which wheel commands are executed, and for how long.
"""

import threading
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from plant.sim.simulation import Plant
from protocol.bus.bus import Bus, Presence
from protocol.bus.publisher import Publisher
from protocol.topics import CLOCK, DRIVE, SONAR, TRUTH, WHEELS, Role
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.messages import SystemTime, WheelCommand
from runtime.units import CONTROL_HZ, PERIOD_MS, PERIOD_NS, UINT32

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
        self._answered: int | None = None
        """The newest tick that has been answered, also by a robot that may not drive: the time in
        which it may not passes only by the ticks that it answers."""
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
        """Return whether a robot has answered the newest tick."""
        return self._answered is not None and self._answered == self._ticks[-1]

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
            if tick == newest:
                self._answered = tick
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


class PlantLink:
    """Publish what one robot senses in this tick, and pass its newest command to the plant.

    In lockstep the clock is published last: it signals that all sensor data of this tick have been
    sent, even if a fault suppresses some.
    """

    def __init__(
        self, bus: Bus, robot: str, number: int, notify: Callable[[int], None], *, lockstep: bool
    ) -> None:
        self.robot = robot
        self._number = number
        self._sonar = bus.publisher(SONAR, robot)
        self._wheels = bus.publisher(WHEELS, robot)
        self._truth = bus.publisher(TRUTH, robot)
        self._clock = bus.publisher(CLOCK, robot) if lockstep else None
        self._gate = CommandGate()
        self._sessions: frozenset[str] = frozenset()
        self._is_gone = self._is_silent = False

        def check(command: WheelCommand) -> str:
            """Notify of refused commands too, which may answer a tick; a mailbox does not."""
            why = self._gate.receive(command)
            if why:
                notify(0)
            return why

        bus.mailbox(DRIVE, robot, notify, check=check)

    @property
    def publishers(self) -> list[Publisher[Any]]:
        """The publishers to which a robot must subscribe before the first tick."""
        return [self._sonar, self._wheels, *([self._clock] if self._clock else [])]

    def publish(self, plant: Plant) -> None:
        """Publish all data of this tick."""
        for publisher, frame in self.frames(plant):
            publisher.put_frame(frame)
        self.publish_clock_and_truth(plant)

    def publish_clock_and_truth(self, plant: Plant) -> None:
        """Publish what follows the sensor data: the clock, in lockstep only, and the truth."""
        if self._clock is not None:
            now_us = plant.now_ns // 1000
            boot_ms = (now_us // 1000) & UINT32
            self._clock.put(SystemTime(time_unix_usec=now_us, time_boot_ms=boot_ms))
        self._truth.put(plant.truth(self._number))

    def frames(self, plant: Plant) -> list[tuple[Publisher[Any], bytes]]:
        """Return the sensor data of this tick as frames, to be sent without a pause.

        From now on commands may answer this tick. The scan follows the wheel ticks, because its
        arrival starts the robot's tick.
        """
        self._gate.begin_tick(plant.now_ns // PERIOD_NS)
        wheels, scan = plant.senses(self._number)
        frames: list[tuple[Publisher[Any], bytes]] = []
        if wheels is not None:
            frames.append((self._wheels, self._wheels.frame(wheels)))
        if scan is not None:
            frames.append((self._sonar, self._sonar.frame(scan)))
        return frames

    @property
    def answered(self) -> bool:
        """Return whether the robot has answered the sensor data of this tick."""
        return self._gate.answered

    @property
    def expected(self) -> bool:
        """Whether a tick waits for this robot: it has not gone, and answered when last expected.

        A silent robot is expected again as soon as it has answered a tick in time.
        """
        if self._is_silent and self.answered:
            self._is_silent = False
        return not (self._is_gone or self._is_silent)

    def expect_no_more(self) -> None:
        """Advance without the robot until it answers."""
        self._is_silent = True

    def note_presence(self, token: Presence, appeared: bool) -> None:
        """Note a process that has appeared or disappeared; called by the bus.

        A robot has gone when its last token has disappeared. One without tokens is never gone.
        """
        if (token.robot, token.role) != (self.robot, Role.ROBOT.value):
            return
        session = {token.zid}
        self._sessions = self._sessions | session if appeared else self._sessions - session
        self._is_gone = not self._sessions
        self._is_silent = False

    def apply_command(self, plant: Plant) -> None:
        """Pass an admitted command to the motor driver, for its remaining time."""
        demand = self._gate.take()
        if demand is not None:
            plant.command(self._number, *demand)
