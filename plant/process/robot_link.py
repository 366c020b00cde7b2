"""One robot's wires at the plant: its senses and the truth out, its wheel command in."""

from collections.abc import Callable
from typing import Any

from plant.process.command_gate import CommandGate
from plant.sim.simulation import Plant
from protocol.bus.bus import Bus
from protocol.bus.publisher import Publisher
from protocol.topics import CLOCK, DRIVE, SONAR, TRUTH, WHEELS
from protocol.wire.messages import SystemTime
from runtime.timing import PERIOD_NS, UINT32


class RobotLink:
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
        self._gate = CommandGate()
        bus.mailbox(DRIVE, robot, notify, check=self._gate.receive)

    @property
    def publishers(self) -> list[Publisher[Any]]:
        """Those a robot must subscribe to before the first tick."""
        return [self._sonar, self._wheels, *([self._clock] if self._clock else [])]

    def publish(self, plant: Plant) -> None:
        """All that belongs to this tick."""
        for publisher, frame in self.frames(plant):
            publisher.put_frame(frame)
        self.tell(plant)

    def tell(self, plant: Plant) -> None:
        """What follows the senses: in lockstep the clock, and the truth."""
        if self._clock is not None:
            now_us = plant.now_ns // 1000
            boot_ms = (now_us // 1000) & UINT32
            self._clock.put(SystemTime(time_unix_usec=now_us, time_boot_ms=boot_ms))
        self._truth.put(plant.truth(self._number))

    def frames(self, plant: Plant) -> list[tuple[Publisher[Any], bytes]]:
        """The senses of this tick as frames, to leave one right after the other.

        From now on commands may answer this tick. The scan comes after the wheel ticks: its arrival
        starts the robot's tick.
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
        """Whether the robot has answered the senses of this very tick."""
        return self._gate.answered

    def obey(self, plant: Plant) -> None:
        """Hand what the gate has admitted to the motor driver, for what is left of its time."""
        demand = self._gate.take()
        if demand is not None:
            plant.command(self._number, *demand)
