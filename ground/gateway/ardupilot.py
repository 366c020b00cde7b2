"""All that is particular to ArduPilot's Rover: its modes, states and versions."""

from types import MappingProxyType
from typing import Final, NamedTuple

from ground.gateway.dialect import MavMessage, mavlink
from ground.gateway.port import Snapshot
from protocol.wire.enums import Mode, Vehicle

INITIALISING: Final = mavlink.ROVER_MODE_INITIALIZING
RTL: Final = mavlink.ROVER_MODE_RTL
MODES: Final = MappingProxyType(
    {
        Mode.MANUAL: mavlink.ROVER_MODE_MANUAL,
        Mode.HOLD: mavlink.ROVER_MODE_HOLD,
        Mode.AUTO: mavlink.ROVER_MODE_AUTO,
        Mode.SMART_RTL: mavlink.ROVER_MODE_SMART_RTL,
        Mode.GUIDED: mavlink.ROVER_MODE_GUIDED,
    }
)
"""The number of each of the robot's modes; they are the same numbers."""
SATELLITES: Final = 10
"""A number of satellites that clients take for a good fix; there is no receiver."""
MODES_BY_NUMBER: Final = MappingProxyType(
    {number: mode for mode, number in MODES.items()} | {RTL: Mode.SMART_RTL}
)
"""The mode for each number that a client may choose. RTL follows the trail like SMART_RTL."""
FORCE: Final = (2989, 21196)
"""Values of parameter 2 of COMPONENT_ARM_DISARM that force it: of arming, and of disarming."""
EMERGENCIES: Final = MappingProxyType(
    {
        Vehicle.BOOT: mavlink.MAV_STATE_BOOT,
        Vehicle.FAILSAFE: mavlink.MAV_STATE_CRITICAL,
        Vehicle.EMERGENCY_STOP: mavlink.MAV_STATE_EMERGENCY,
    }
)


class State(NamedTuple):
    """What a heartbeat tells: mode, whether armed, and MAV_STATE."""

    mode: int
    is_armed: bool
    system_status: int

    def heartbeat(self) -> MavMessage:
        """Return the message."""
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.is_armed else 0
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GROUND_ROVER,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed,
            self.mode,
            self.system_status,
            3,
        )


def state_of(snapshot: Snapshot, number: int | None = None) -> State:
    """Return the state that clients see. A robot without telemetry is INITIALISING, not live.

    `number` is the mode that clients see, by default that of the robot.
    """
    status = snapshot.status
    if status is None:
        return State(INITIALISING, False, mavlink.MAV_STATE_UNINIT)
    is_armed = status.vehicle == Vehicle.ACTIVE
    usual = mavlink.MAV_STATE_STANDBY if status.mode == Mode.HOLD else mavlink.MAV_STATE_ACTIVE
    system_status = EMERGENCIES.get(Vehicle(status.vehicle), usual)
    return State(int(status.mode) if number is None else number, is_armed, system_status)
