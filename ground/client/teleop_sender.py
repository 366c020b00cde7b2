"""Speeds of a drive by hand. Each expires after a moment, so the robot stops on silence."""

from typing import Final

from protocol.bus.bus import Bus
from protocol.bus.publisher import Publisher
from protocol.topics import TELEOP
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.messages import NavigatorStatus, Teleop
from protocol.wire.reasons import reason_text
from runtime.clock import Clock

TTL_MS: Final = 250
READY_S: Final = 0.5
SETTLE_NS: Final = 500_000_000
"""Time that a robot may take to follow."""


class TeleopSender:
    """Sends an operator's speeds; each must be repeated before it expires."""

    def __init__(self, bus: Bus, robot: str, clock: Clock) -> None:
        self._bus, self._robot, self._clock = bus, robot, clock
        self._seq = 0
        self._publisher: Publisher[Teleop] | None = None

    def open(self) -> Publisher[Teleop]:
        """Declare the publisher and wait a moment for the robot, once."""
        if self._publisher is None:
            self._publisher = self._bus.publisher(TELEOP, self._robot)
            self._bus.await_matched([self._publisher], timeout_s=READY_S)
        return self._publisher

    def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Send the speeds once; they expire after TTL_MS."""
        publisher = self.open()
        self._seq += 1
        publisher.put(
            Teleop(
                time_ns=self._clock.now_ns(),
                seq=self._seq,
                speed_mm_s=round(speed_m_s * 1000),
                yaw_rate_mrad_s=round(yaw_rate_rad_s * 1000),
                ttl_ms=TTL_MS,
            )
        )

    def stop(self) -> None:
        """Send zero speed once."""
        self.drive(0.0, 0.0)


def lost_control(status: NavigatorStatus, driven_ns: int) -> str:
    """Return why the robot no longer follows the operator; empty while it does."""
    if status.vehicle != Vehicle.ACTIVE and driven_ns > SETTLE_NS:
        return reason_text(status.vehicle_reason) if status.vehicle_reason else "not armed"
    if status.mode != Mode.MANUAL and driven_ns > SETTLE_NS:
        return "the robot has left MANUAL mode"
    return ""
