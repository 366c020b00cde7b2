"""What the fleet says of itself: how soon commands follow senses, ticks missed, who is silent."""

from collections import deque
from contextlib import suppress
from functools import partial
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


class Heard:
    """One robot, as its streams arrive at one place; filled in the bus's thread."""

    def __init__(self, began_ns: int) -> None:
        self._began_ns = began_ns
        self._scans: deque[tuple[int, int]] = deque(maxlen=REMEMBERED)
        self._tick: CycleReport | None = None
        self.status: NavigatorStatus | None = None
        self.pose: PlanarOdometry | None = None
        self.heard_ns = {SonarScan: 0, NavigatorStatus: 0}
        self.delays_ms: list[tuple[float, float]] = []
        """When a command came, in s from the beginning, and how long after its scan."""
        self.ticks: list[tuple[float, int]] = []
        """When a report came, and how many ticks had been missed since the one before it."""

    def take(self, _key: str, frame: bytes, at_ns: int) -> None:
        with suppress(RemoteError):
            self._take(decode(frame).message, at_ns)

    def _take(self, message: Message, at_ns: int) -> None:
        at_s = (at_ns - self._began_ns) / NS_PER_S
        if isinstance(message, SonarScan):
            self._scans.append((message.seq, at_ns))
            self.heard_ns[SonarScan] = at_ns
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
            self.heard_ns[NavigatorStatus] = at_ns

    def silent_since(self, at_ns: int) -> bool:
        """Has it, or its senses, not been heard after that?"""
        return min(self.heard_ns.values()) <= at_ns


def listen(bus: Bus, robots: tuple[str, ...], began_ns: int) -> dict[str, Heard]:
    found = {}
    for robot in robots:
        heard = found[robot] = Heard(began_ns)
        for topic in (SONAR, DRIVE, CYCLE, STATUS, ODOMETRY):
            bus.stream(topic, partial(Heard.take, heard), robot)
    return found
