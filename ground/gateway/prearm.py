"""What keeps the robot from being armed, as far as its telemetry shows."""

from typing import Final

from ground.gateway.port import HINTS, Snapshot
from protocol.wire.enums import Vehicle
from protocol.wire.reasons import Reason, reason_text

EMERGENCY_STOPPED: Final = (
    f"{reason_text(Reason.EMERGENCY_STOPPED)} ({HINTS[Reason.EMERGENCY_STOPPED]})"
)


def faults(snapshot: Snapshot) -> tuple[str, ...]:
    """Return the reasons, for a person; none if the robot can be armed or is armed.

    A failsafe ends by arming again, so it counts as none while the robot has its senses.
    """
    status = snapshot.status
    if status is None:
        return ("no telemetry arrives from the robot",)
    if status.vehicle == Vehicle.EMERGENCY_STOP:
        return (EMERGENCY_STOPPED,)
    if status.vehicle == Vehicle.BOOT or snapshot.scan is None or snapshot.wheels is None:
        return (reason_text(Reason.NO_SENSES),)
    if status.vehicle_reason == Reason.FENCE_UNREADABLE:
        return (reason_text(Reason.FENCE_UNREADABLE),)
    return ()
