"""Speeds in GUIDED: the robot is in MANUAL, where it accepts speeds, and clients receive GUIDED.

It ends with the time-out of the last speed, another mode, a goal, or the loss of control. After a
time-out the robot stops and is in GUIDED, like ArduPilot's Rover.
"""

from enum import Enum, auto
from typing import Final

from gateways.mavlink.motion.pilot import DriveBegun, Pilot
from gateways.mavlink.motion.velocity import LIFE_NS, REPEAT_NS, Velocity
from gateways.mavlink.port import Answered
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle
from protocol.wire.enums import Mode
from runtime.units import NS_PER_MS, NS_PER_S

TIMEOUT_NS: Final = NS_PER_S
BRAKING_NS: Final = 200 * NS_PER_MS
"""After a time-out the robot keeps its mode for so long: in MANUAL its wheels brake, in GUIDED they
would run out."""


class Stage(Enum):
    """The state of the change between the robot's own modes."""

    IDLE = auto()
    ENTERING = auto()
    DRIVING = auto()
    LEAVING = auto()


class GuidedDrive:
    """Repeats the newest speeds of a client to the robot until they time out."""

    def __init__(self, vehicle: Vehicle, pilot: Pilot) -> None:
        self._vehicle = vehicle
        self._pilot = pilot
        self._stage = Stage.IDLE
        self._velocity = Velocity()
        self._sender: Sender | None = None
        self._until_ns = self._leave_ns = self._sent_ns = self._now_ns = 0
        self._drive_id = 0

    def follow(self, velocity: Velocity, sender: Sender, now_ns: int) -> None:
        """Drive with these speeds until newer ones arrive or they time out."""
        self._velocity, self._sender, self._now_ns = velocity, sender, now_ns
        self._until_ns = now_ns + TIMEOUT_NS
        self._leave_ns = self._until_ns + BRAKING_NS
        if self._stage is Stage.IDLE:
            self._enter()
        elif self._stage is Stage.DRIVING:
            self._drive()

    @property
    def is_active(self) -> bool:
        """True while the robot follows speeds."""
        return self._stage is not Stage.IDLE

    def end(self) -> None:
        """Stop following speeds, because a goal follows."""
        self._until_ns = self._leave_ns = 0
        if self._stage is Stage.DRIVING:
            self._stop()

    def due(self, now_ns: int) -> None:
        """Repeat the speeds, or end the drive."""
        self._now_ns = now_ns
        modes, sender = self._vehicle.modes, self._sender
        if self._stage is not Stage.DRIVING or sender is None:
            return
        if modes.mode is not Mode.MANUAL or modes.number != Mode.GUIDED:
            self._stage = Stage.IDLE
            if modes.mode is Mode.MANUAL:
                self._stop()
        elif not self._vehicle.control.holds(sender):
            self._stop()
            self._stage = Stage.IDLE
            self._pilot.hold_drive(self._drive_id)
        elif now_ns >= self._leave_ns:
            self._stage = Stage.LEAVING
            self._pilot.await_goal(self._drive_id, sender, self._left)
        elif now_ns - self._sent_ns >= REPEAT_NS and self._is_valid():
            self._drive()

    def _is_valid(self) -> bool:
        return self._now_ns <= self._until_ns - LIFE_NS

    def _enter(self) -> None:
        if self._sender is not None:
            self._stage = Stage.ENTERING
            self._pilot.velocity(self._sender, self._entered)

    def _entered(self, answered: Answered) -> None:
        if answered.ok:
            begun = answered.outcome
            self._drive_id = begun.drive_id if isinstance(begun, DriveBegun) else 0
            self._stage = Stage.DRIVING
            if self._is_valid():  # the answer may have been late
                self._drive()
        else:
            self._refused(answered)

    def _left(self, answered: Answered) -> None:
        self._stage = Stage.IDLE
        if not answered.ok:
            self._pilot.hold_drive(self._drive_id)
        elif self._now_ns < self._until_ns:
            self._enter()

    def _refused(self, answered: Answered) -> None:
        self._stage = Stage.IDLE
        if self._sender is not None:
            words = f"speeds not followed: {answered.text}"
            self._vehicle.refusals.say(words, self._sender.client, self._now_ns)

    def _drive(self) -> None:
        odometry = self._vehicle.snapshot.odometry
        heading_rad = None if odometry is None else odometry.heading_rad
        self._sent_ns = self._now_ns
        self._vehicle.port.drive(*self._velocity.twist(heading_rad))

    def _stop(self) -> None:
        self._vehicle.port.drive(0.0, 0.0)
