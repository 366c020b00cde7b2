"""Telemetry of the fleet: delay from senses to commands, missed ticks, silent robots."""

from collections import deque
from contextlib import suppress
from typing import Final

from protocol.bus.bus import Bus
from protocol.topics import CYCLE, DRIVE, ODOMETRY, SONAR, STATUS
from protocol.wire.codec import decode
from protocol.wire.message import Message
from protocol.wire.messages import (
    CycleReport,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    WheelCommand,
)
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

REMEMBERED: Final = 64


class RobotTelemetry:
    """The streams of one robot as they arrive; filled in the bus's thread."""

    def __init__(self, began_ns: int) -> None:
        self._began_ns = began_ns
        self._scans: deque[tuple[int, int]] = deque(maxlen=REMEMBERED)
        self._tick: CycleReport | None = None
        self.status: NavigatorStatus | None = None
        self.pose: PlanarOdometry | None = None
        self._arrived_ns = {SonarScan: 0, NavigatorStatus: 0}
        self.delays_ms: list[tuple[float, float]] = []
        """Arrival of a command in s from the beginning, and its delay after the scan."""
        self.ticks: list[tuple[float, int]] = []
        """Arrival of a report, and the ticks missed since the report before."""

    def record(self, _key: str, frame: bytes, at_ns: int) -> None:
        """Record a frame; unreadable frames are ignored."""
        with suppress(RemoteError):
            self._record(decode(frame).message, at_ns)

    def _record(self, message: Message, at_ns: int) -> None:
        at_s = (at_ns - self._began_ns) / NS_PER_S
        if isinstance(message, SonarScan):
            self._scans.append((message.seq, at_ns))
            self._arrived_ns[SonarScan] = at_ns
        elif isinstance(message, WheelCommand):
            self.delays_ms += [
                (at_s, (at_ns - scan_ns) / 1e6)
                for seq, scan_ns in self._scans
                if seq == message.sense_seq
            ][-1:]
        elif isinstance(message, CycleReport):
            before, self._tick = self._tick, message
            if before is not None and message.tick > before.tick:
                self.ticks.append((at_s, message.missed - before.missed))
        elif isinstance(message, PlanarOdometry):
            self.pose = message
        elif isinstance(message, NavigatorStatus):
            self.status = message
            self._arrived_ns[NavigatorStatus] = at_ns

    def silent_since(self, at_ns: int) -> bool:
        """Return whether no status or no scan has arrived since then."""
        return min(self._arrived_ns.values()) <= at_ns


def subscribe(bus: Bus, robots: tuple[str, ...], began_ns: int) -> dict[str, RobotTelemetry]:
    """Record the telemetry of all robots from now on."""
    found = {robot: RobotTelemetry(began_ns) for robot in robots}
    for robot, telemetry in found.items():
        for topic in (SONAR, DRIVE, CYCLE, STATUS, ODOMETRY):
            bus.stream(topic, telemetry.record, robot)
    return found
