"""Link of the plant to one robot: sensor data and ground truth out, wheel commands in."""

from collections.abc import Callable
from typing import Any

from plant.process.command_gate import CommandGate
from plant.sim.simulation import Plant
from protocol.bus.bus import Bus
from protocol.bus.presence import Presence
from protocol.bus.publisher import Publisher
from protocol.topics import CLOCK, DRIVE, SONAR, TRUTH, WHEELS, Role
from protocol.wire.messages import SystemTime
from runtime.timing import PERIOD_NS, UINT32


class RobotLink:
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
        bus.mailbox(DRIVE, robot, notify, check=self._gate.receive)

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
