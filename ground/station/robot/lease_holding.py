"""Hold the lease of one robot and send the heartbeat of this program."""

from typing import Final

from ground.client.requests import CROSSING_NS, HeartbeatTimer
from ground.robot import Robot
from ground.station.robot.lease_state import UNKNOWN, lease_from
from protocol.wire.messages import LeaseStatus
from runtime.units import NS_PER_MS, NS_PER_S

SETTLED_NS: Final = 110 * NS_PER_MS
"""Time after the first heartbeat until the robot has processed it."""
NEW_NS: Final = NS_PER_S
"""Time after a use within which the status may show the time that was left before."""
LEAST_S: Final = 2.0
"""With less time left, the robot may give the lease back while a request is on its way.

Heartbeats keep it above, until the lease ends because nothing is driven.
"""


class LeaseHolding:
    """State of the lease; `ours` while the person at this station has it, with any program.

    This program sends its heartbeat from the time that it took or used the lease.
    """

    def __init__(self, own: str) -> None:
        self.lease = UNKNOWN
        self.ours = False
        self._own = own
        self._used_ns: int | None = None
        self._pace = HeartbeatTimer()
        self._changed_ns = 0
        self._first_heartbeat_ns: int | None = None

    @property
    def is_used(self) -> bool:
        """True while this program takes part in commanding the robot."""
        return self.ours and self._used_ns is not None

    def is_sure(self, now_ns: int) -> bool:
        """Return whether the lease is there when a request arrives; else take it before."""
        if not self.ours or self._used_ns is None:
            return False
        return now_ns - self._used_ns < NEW_NS or self.lease.lapses_s >= LEAST_S

    def use(self, now_ns: int) -> None:
        """Note that this program commands the robot."""
        self._used_ns = now_ns

    def granted(self, now_ns: int) -> None:
        """Note that the robot granted the lease."""
        if not self.ours:  # its status may have come before its answer
            self._change(True, now_ns)
        self._used_ns = now_ns

    def release(self, now_ns: int) -> None:
        """Note that the lease was released."""
        self._change(False, now_ns)

    def _change(self, ours: bool, now_ns: int) -> None:
        self.ours = ours
        self._changed_ns = now_ns
        self._used_ns = self._first_heartbeat_ns = None

    def receive(self, status: LeaseStatus, arrived_ns: int, now_ns: int) -> str:
        """Note a lease status; return a sentence when another person has the lease, or this one.

        The robot itself says how a lease has ended.
        """
        self.lease = lease_from(status, now_ns - arrived_ns, self._own)
        ours = self.lease.ours
        if ours == self.ours or arrived_ns < self._changed_ns + CROSSING_NS:
            return ""
        self._change(ours, now_ns)
        if self.lease.own:
            self._used_ns = now_ns
        if ours:
            by = "" if self.lease.own else f" (by {self.lease.name})"
            return f"you are in command{by}"
        return f"{self.lease.words} is in command now" if status.held else ""

    def settled(self, now_ns: int) -> bool:
        """Return whether the robot has had time to process a heartbeat."""
        return (
            self._first_heartbeat_ns is not None and now_ns - self._first_heartbeat_ns >= SETTLED_NS
        )

    def beat(self, robot: Robot, now_ns: int, stamp_ns: int) -> None:
        """Send a heartbeat if it is due and this program uses the lease."""
        if not self.is_used or not self._pace.due(now_ns, stamp_ns):
            return
        robot.lease.beat()
        if self._first_heartbeat_ns is None:
            self._first_heartbeat_ns = now_ns
