"""Being the operator of one robot: the lease that is held, and the heart that beats for it."""

from typing import Final

from ground.client.link import ALIVE
from ground.client.requests import HeartbeatTimer
from ground.station.bus_protocols import MessagePublisher
from ground.station.robot.lease_state import UNKNOWN, lease_in
from protocol.wire.messages import Heartbeat, LeaseStatus
from runtime.units import NS_PER_MS

SETTLED_NS: Final = 110 * NS_PER_MS
"""So long after the first beat the robot has heard it in one of its ticks."""
CROSSING_NS: Final = 300 * NS_PER_MS
"""What the robot said of its lease just before it changed may arrive after that."""


class LeaseHolding:
    """`ours` from the robot's yes to our release, its loss, or somebody else's name on it.

    A lease that was taken in our name by other hands (a typed `lease take`) is ours all the same.
    """

    def __init__(self, zid: str) -> None:
        self.lease = UNKNOWN
        self.ours = False
        self._zid = zid
        self._pace = HeartbeatTimer()
        self._changed_ns = 0
        self._beaten_ns: int | None = None

    def granted(self, now_ns: int) -> None:
        if not self.ours:  # its status may have come before its answer
            self._change(True, now_ns)

    def given_up(self, now_ns: int) -> None:
        self._change(False, now_ns)

    def _change(self, ours: bool, now_ns: int) -> None:
        self.ours = ours
        self._changed_ns = now_ns
        self._beaten_ns = None

    def heard(self, status: LeaseStatus, arrived_ns: int, now_ns: int) -> str:
        """What the robot says of its lease; a sentence when that changes whose it is."""
        self.lease = lease_in(status, now_ns - arrived_ns, self._zid)
        ours = self.lease.ours
        if ours == self.ours or arrived_ns < self._changed_ns + CROSSING_NS:
            return ""
        self._change(ours, now_ns)
        if ours:
            return "the lease is ours"
        return f"{self.lease.words} has taken the lease" if status.held else "the lease has lapsed"

    def settled(self, now_ns: int) -> bool:
        """Has the robot had time to hear that its operator is there?"""
        return self._beaten_ns is not None and now_ns - self._beaten_ns >= SETTLED_NS

    def beat(self, heart: MessagePublisher[Heartbeat], now_ns: int, stamp_ns: int) -> None:
        """Beat if it is time to; only an operator has a heart."""
        if not self.ours or not self._pace.due(now_ns, stamp_ns):
            return
        heart.put(ALIVE)
        if self._beaten_ns is None:
            self._beaten_ns = now_ns
