"""The behaviour that is specific to ArduPilot's Rover: its modes, states and versions."""

from hashlib import sha256
from types import MappingProxyType
from typing import Final, NamedTuple

from gateways.mavlink.mavlink_dialect import AvailableModes, CurrentMode, MavMessage, mavlink
from gateways.mavlink.robot_port import Snapshot
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
"""ArduPilot's number of each of the robot's modes; both use equal numbers."""
SATELLITES: Final = 10
"""A number of satellites that clients accept as a good fix; the robot has no GPS receiver."""
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


VERSION: Final = (4, 7, 0)
"""The release whose behaviour this follows. Its type is DEV, which QGroundControl compares with
no list of releases."""
CAPABILITIES: Final = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_FTP
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
)
AUTO_MODE: Final = 4
"""MAV_MODE_PROPERTY_AUTO_MODE."""
MODE_LIST: Final = (
    (mavlink.ROVER_MODE_MANUAL, "Manual", 0),
    (mavlink.ROVER_MODE_HOLD, "Hold", 0),
    (mavlink.ROVER_MODE_AUTO, "Auto", AUTO_MODE),
    (mavlink.ROVER_MODE_RTL, "RTL", AUTO_MODE),
    (mavlink.ROVER_MODE_SMART_RTL, "Smart RTL", AUTO_MODE),
    (mavlink.ROVER_MODE_GUIDED, "Guided", AUTO_MODE),
)
"""The modes in the order of AVAILABLE_MODES, with names as QGroundControl has them for a Rover."""


MODE_BITS: Final = MappingProxyType(
    {mavlink.ROVER_MODE_MANUAL: mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED}
    | {
        number: mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        for number, _, properties in MODE_LIST
        if properties
    }
)
"""The bits of base_mode that mavros shows as `manual_input` and `guided`, by the mode."""


class MavState(NamedTuple):
    """The state in a heartbeat: mode, whether armed, and MAV_STATE."""

    mode: int
    is_armed: bool
    system_status: int

    def heartbeat(self) -> MavMessage:
        """Return the message."""
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.is_armed else 0
        steered = MODE_BITS.get(self.mode, 0)
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GROUND_ROVER,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed | steered,
            self.mode,
            self.system_status,
            3,
        )


def state_of(snapshot: Snapshot, number: int | None = None, *, was_armed: bool = False) -> MavState:
    """Return the state that clients see. A robot without telemetry is INITIALISING, not live.

    Its state is then MAVLink's "unknown", but one that `was_armed` is not shown as disarmed: it may
    still drive. `number` is the mode that clients see, by default that of the robot.
    """
    status = snapshot.status
    if status is None:
        return MavState(INITIALISING, was_armed, mavlink.MAV_STATE_UNINIT)
    is_armed = status.vehicle == Vehicle.ACTIVE
    mode = int(status.mode) if number is None else number
    usual = mavlink.MAV_STATE_STANDBY if mode == Mode.HOLD else mavlink.MAV_STATE_ACTIVE
    system_status = EMERGENCIES.get(Vehicle(status.vehicle), usual)
    return MavState(mode, is_armed, system_status)


def current_mode(number: int) -> MavMessage:
    """Return CURRENT_MODE. Like ArduPilot, it declares every mode as not standard."""
    return CurrentMode(0, number, 0)


def available_modes(index: int) -> list[MavMessage]:
    """Return AVAILABLE_MODES of one mode, counted from 1, or of all modes for 0."""
    return [
        AvailableModes(len(MODE_LIST), at, 0, number, properties, name.encode())
        for at, (number, name, properties) in enumerate(MODE_LIST, start=1)
        if index in (0, at)
    ]


def autopilot_version(name: str, commit: str) -> MavMessage:
    """Return AUTOPILOT_VERSION of a robot; its unique id follows from its name."""
    major, minor, patch = VERSION
    unique = sha256(name.encode()).digest()
    return mavlink.MAVLink_autopilot_version_message(
        CAPABILITIES,
        major << 24 | minor << 16 | patch << 8 | mavlink.FIRMWARE_VERSION_TYPE_DEV,
        *(0, 0, 0),
        commit.encode()[:8].ljust(8, b"\0"),
        *([0] * 8, [0] * 8),
        *(0, 0),
        int.from_bytes(unique[:8], "little"),
        list(unique[:18]),
    )


def banner(name: str, commit: str) -> tuple[str, ...]:
    """Return the texts that name the version, in the form that clients recognise, and the robot."""
    release = ".".join(map(str, VERSION))
    return (f"ArduRover V{release}-dev ({commit[:8] or 'unknown'})", f"Sidestep robot {name}")
