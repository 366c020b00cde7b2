"""One robot's wires at the plant: its senses and the truth out, its wheel command in."""

from collections.abc import Callable
from typing import Any

from plant.plant import Plant
from protocol.bus import Bus, Publisher
from protocol.messages import SystemTime, WheelCommand
from protocol.timing import PERIOD_MS, PERIOD_NS
from protocol.topics import CLOCK, DRIVE, SONAR, TRUTH, WHEELS


class Wires:
    """Publishes what one robot senses at this tick and hands its newest command to the plant.

    The clock goes out last, and only in lockstep: it tells the robot that all its senses of this
    tick are there, even when a fault keeps them back.
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
        self._command = bus.mailbox(DRIVE, robot, notify)
        self._obeyed: WheelCommand | None = None

    @property
    def publishers(self) -> list[Publisher[Any]]:
        """Those a robot must subscribe to before the first tick."""
        return [self._sonar, self._wheels, *([self._clock] if self._clock else [])]

    def publish(self, plant: Plant) -> None:
        """All that belongs to this tick."""
        for publisher, frame in self.framed(plant):
            publisher.put_frame(frame)
        self.tell(plant)

    def tell(self, plant: Plant) -> None:
        """What follows the senses: in lockstep the clock, and the truth."""
        if self._clock is not None:
            now_us = plant.now_ns // 1000
            self._clock.put(SystemTime(time_unix_usec=now_us, time_boot_ms=now_us // 1000))
        self._truth.put(plant.truth(self._number))

    def framed(self, plant: Plant) -> list[tuple[Publisher[Any], bytes]]:
        """The senses of this tick as frames, to leave one right after the other.

        The scan comes after the ticks: its arrival starts the robot's tick.
        """
        wheels, scan = plant.senses(self._number)
        frames: list[tuple[Publisher[Any], bytes]] = []
        if wheels is not None:
            frames.append((self._wheels, self._wheels.frame(wheels)))
        if scan is not None:
            frames.append((self._sonar, self._sonar.frame(scan)))
        return frames

    def answered(self, plant: Plant) -> bool:
        """Whether the robot has answered the senses of this very tick."""
        newest = self._command.latest()
        return newest is not None and newest[0].sense_seq == plant.now_ns // PERIOD_NS

    def obey(self, plant: Plant) -> None:
        """Hand a new command to the motor driver, for what is left of its time-to-live.

        That counts from the senses it answers, on this clock: neither a command that was long on
        its way nor a copy of it lets the wheels turn for longer. One overtaken by a newer is late;
        one with no time to live brakes.
        """
        newest = self._command.latest()
        if newest is None or newest[0] is self._obeyed:
            return
        command, last = newest[0], self._obeyed
        age_ms = (plant.now_ns // PERIOD_NS - command.sense_seq) * PERIOD_MS
        left_ms = command.ttl_ms - max(0, age_ms)
        if left_ms < 0 or (last is not None and overtaken(command, last)):
            return
        self._obeyed = command
        plant.command(self._number, command.left_mrad_s, command.right_mrad_s, left_ms)


def overtaken(command: WheelCommand, last: WheelCommand) -> bool:
    """Was it sent before the last one? A robot that began anew counts from 0 again, later on."""
    return (command.sense_seq, command.seq) < (last.sense_seq, last.seq)
