"""The reasons why the robot cannot be armed, from its telemetry."""

from typing import Final

from gateways.mavlink.port import HINTS, NO_TELEMETRY, Snapshot
from protocol.wire.enums import Vehicle
from protocol.wire.reasons import Reason, reason_text

EMERGENCY_STOPPED: Final = (
    f"{reason_text(Reason.EMERGENCY_STOPPED)} ({HINTS[Reason.EMERGENCY_STOPPED]})"
)


def faults(snapshot: Snapshot) -> tuple[str, ...]:
    """Return the reasons as texts; none if the robot can be armed or is armed.

    Arming again ends a failsafe, so a failsafe is no reason while sensor data arrive.
    """
    status = snapshot.status
    if status is None:
        return (NO_TELEMETRY,)
    if status.vehicle == Vehicle.EMERGENCY_STOP:
        return (EMERGENCY_STOPPED,)
    if status.vehicle == Vehicle.BOOT or snapshot.scan is None or snapshot.wheels is None:
        return (reason_text(Reason.NO_SENSES),)
    if status.vehicle_reason == Reason.FENCE_UNREADABLE:
        return (reason_text(Reason.FENCE_UNREADABLE),)
    return ()
