"""Hold the lease of one robot and send the operator's heartbeat."""

from typing import Final

from ground.client.link import ALIVE
from ground.client.requests import HeartbeatTimer
from ground.station.bus_protocols import MessagePublisher
from ground.station.robot.lease_state import UNKNOWN, lease_from
from protocol.wire.messages import Heartbeat, LeaseStatus
from runtime.units import NS_PER_MS

SETTLED_NS: Final = 110 * NS_PER_MS
"""Time after the first heartbeat until the robot has processed it."""
CROSSING_NS: Final = 300 * NS_PER_MS
"""A lease status sent before a change may arrive up to this time after it."""


class LeaseHolding:
    """State of the lease; `ours` from the grant until release, lapse, or another holder.

    A lease taken under this station's identity by a typed `lease take` is `ours`, too.
    """

    def __init__(self, zid: str) -> None:
        self.lease = UNKNOWN
        self.ours = False
        self._zid = zid
        self._pace = HeartbeatTimer()
        self._changed_ns = 0
        self._first_heartbeat_ns: int | None = None

    def granted(self, now_ns: int) -> None:
        """Note that the robot granted the lease."""
        if not self.ours:  # its status may have come before its answer
            self._change(True, now_ns)

    def release(self, now_ns: int) -> None:
        """Note that the lease was released."""
        self._change(False, now_ns)

    def _change(self, ours: bool, now_ns: int) -> None:
        self.ours = ours
        self._changed_ns = now_ns
        self._first_heartbeat_ns = None

    def receive(self, status: LeaseStatus, arrived_ns: int, now_ns: int) -> str:
        """Note a lease status; return a sentence when the holder has changed."""
        self.lease = lease_from(status, now_ns - arrived_ns, self._zid)
        ours = self.lease.ours
        if ours == self.ours or arrived_ns < self._changed_ns + CROSSING_NS:
            return ""
        self._change(ours, now_ns)
        if ours:
            return "you are in command"
        return f"{self.lease.words} is in command now" if status.held else "the lease has lapsed"

    def settled(self, now_ns: int) -> bool:
        """Return whether the robot has had time to process a heartbeat."""
        return (
            self._first_heartbeat_ns is not None and now_ns - self._first_heartbeat_ns >= SETTLED_NS
        )

    def beat(self, heartbeats: MessagePublisher[Heartbeat], now_ns: int, stamp_ns: int) -> None:
        """Send a heartbeat if it is due and the lease is held."""
        if not self.ours or not self._pace.due(now_ns, stamp_ns):
            return
        heartbeats.put(ALIVE)
        if self._first_heartbeat_ns is None:
            self._first_heartbeat_ns = now_ns
