"""Speeds of a drive by hand. Each expires after a moment, so the robot stops on silence."""

from typing import Final

from ground.client.lease_holder import holder_name
from ground.client.outcomes import DRIVE_REPLACED
from ground.client.requests import CROSSING_NS, NAMED_NS, Latest, replaced_by
from protocol.bus.bus import Bus
from protocol.bus.publisher import Publisher
from protocol.outcome import REPLACED, reason_words
from protocol.topic import person_of
from protocol.topics import LEASE, STATUS, TELEOP
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.messages import LeaseStatus, NavigatorStatus, Teleop
from protocol.wire.reasons import Reason
from runtime.cli.terminal import printable
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


class DriveWatch:
    """Follows a drive by hand, and tells why the robot no longer follows its operator.

    The lease status names the newest drive and the lease holder, the robot's status who holds it.
    """

    def __init__(self, drive_id: int, operator: str, now_ns: int) -> None:
        self._drive_id, self._operator, self._began_ns = drive_id, operator, now_ns
        self._is_shown = False
        self._lost_ns: int | None = None
        self.is_seized = False
        """True once another person has the lease, and with it the drive."""

    def lost(self, latest: Latest, now_ns: int) -> str | None:
        """Return why the drive has ended; empty while it is lost and not known why, None before."""
        newest, lease = latest(STATUS), latest(LEASE)
        status = None if newest is None else newest[0]
        if lease is not None and (words := self._replaced(*lease, status)) is not None:
            self._note(now_ns)
            return words or (DRIVE_REPLACED if self._is_late(now_ns) else "")
        why = "" if status is None else lost_control(status, now_ns - self._began_ns)
        if not why:
            return None
        self._note(now_ns)
        # Who drives now is in the lease status of the same tick, which may still be on its way.
        is_told = status is not None and lease is not None and lease[0].time_ns >= status.time_ns
        return why if is_told or self._is_late(now_ns) else ""

    def _replaced(
        self, lease: LeaseStatus, arrived_ns: int, status: NavigatorStatus | None
    ) -> str | None:
        """Return what drives in place of this drive; empty until it is known, None if nothing."""
        is_ours = lease.drive_id in (0, self._drive_id)
        self._is_shown |= lease.drive_id == self._drive_id
        if not (self._is_shown or arrived_ns - self._began_ns > CROSSING_NS):
            return None  # sent before the robot has accepted this drive
        if is_ours:
            is_others = lease.held and person_of(lease.holder) != person_of(self._operator)
            self.is_seized = bool(is_others)
            return f"{holder_name(lease)} has seized the lease" if is_others else None
        if status is None or status.time_ns < lease.time_ns:
            return ""
        driver = printable(lease.driver)
        if status.goal_id == lease.drive_id:
            return f"{REPLACED} {replaced_by(status, driver)}"
        return f"{REPLACED} by the drive of {driver}" if driver else f"{REPLACED} by another drive"

    def _note(self, now_ns: int) -> None:
        self._lost_ns = now_ns if self._lost_ns is None else self._lost_ns

    def _is_late(self, now_ns: int) -> bool:
        return self._lost_ns is not None and now_ns - self._lost_ns >= NAMED_NS


def lost_control(status: NavigatorStatus, driven_ns: int) -> str:
    """Return why the robot no longer follows the operator; empty while it does."""
    if driven_ns <= SETTLE_NS:
        return ""
    by = printable(status.held_by)
    if status.vehicle != Vehicle.ACTIVE:
        is_disarmed = status.vehicle == Vehicle.STANDBY and status.mode == Mode.MANUAL
        ended = Reason.DISARMED if is_disarmed else Reason.NOT_ARMED
        return reason_words(status.vehicle_reason or ended, status.held_by)
    if status.mode == Mode.HOLD and by:
        return f"held by {by}"
    return "" if status.mode == Mode.MANUAL else "the robot has left MANUAL mode"
