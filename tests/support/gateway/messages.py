"""Messages of clients, and what tests look for in the answers."""

from itertools import count

from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from protocol.wire.enums import MissionState
from protocol.wire.messages import MissionStatus

SYSTEM, COMPONENT = 1, 1
SEQUENCE = count(1)


def numbered(message: MavMessage, sequence: int | None = None) -> MavMessage:
    """Return a message with the next frame number of its client, or a given one."""
    message._header.seq = (next(SEQUENCE) if sequence is None else sequence) & 0xFF
    return message


def command(number: int, *params: float, confirmation: int = 0) -> MavMessage:
    """Return a COMMAND_LONG; parameters that are not given are 0."""
    values = (*params, *(0.0,) * (7 - len(params)))
    return numbered(
        mavlink.MAVLink_command_long_message(SYSTEM, COMPONENT, number, confirmation, *values)
    )


def command_int(
    number: int,
    *params: float,
    x: int = 0,
    y: int = 0,
    z: float = 0.0,
    frame: int = mavlink.MAV_FRAME_GLOBAL,
) -> MavMessage:
    """Return a COMMAND_INT."""
    values = (*params, *(0.0,) * (4 - len(params)))
    return numbered(
        mavlink.MAVLink_command_int_message(
            SYSTEM, COMPONENT, frame, number, 0, 0, *values, x, y, z
        )
    )


def mission_status(state: MissionState, current: int = 0, items: int = 3) -> MissionStatus:
    """Return the status of a mission."""
    return MissionStatus(
        time_ns=0, mission_id=1, hold_left_ms=0, count=items, current=current, state=state, reason=0
    )


def acks(messages: list[MavMessage]) -> list[tuple[int, int]]:
    """Return command and result of each COMMAND_ACK."""
    return [(m.command, m.result) for m in messages if m.get_type() == "COMMAND_ACK"]


def words(messages: list[MavMessage]) -> str:
    """Return the texts of all STATUSTEXTs, pieces joined."""
    texts = (m for m in messages if m.get_type() == "STATUSTEXT")
    return "".join(m.text.decode() if isinstance(m.text, bytes) else m.text for m in texts)


SPEEDS = 0xDC7
"""A type_mask that ignores all but the velocity."""
PLACE = 0xDF8
"""A type_mask that ignores all but the position."""


def local_target(
    frame: int = 1,
    mask: int = SPEEDS,
    x: float = 0.0,
    y: float = 0.0,
    vx: float = 0.0,
    vy: float = 0.0,
    yaw: float = 0.0,
    yaw_rate: float = 0.0,
) -> MavMessage:
    """Return a SET_POSITION_TARGET_LOCAL_NED."""
    return numbered(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, SYSTEM, COMPONENT, frame, mask, x, y, 0, vx, vy, 0, 0, 0, 0, yaw, yaw_rate
        )
    )


def global_target(lat: int, lon: int, frame: int = 6, mask: int = PLACE) -> MavMessage:
    """Return a SET_POSITION_TARGET_GLOBAL_INT."""
    return numbered(
        mavlink.MAVLink_set_position_target_global_int_message(
            0, SYSTEM, COMPONENT, frame, mask, lat, lon, 0, 0, 0, 0, 0, 0, 0, 0, 0
        )
    )


def attitude(
    thrust: float = 0.0, rate: float = 0.0, mask: int = 0, q: tuple[float, ...] = (1, 0, 0, 0)
) -> MavMessage:
    """Return a SET_ATTITUDE_TARGET."""
    return numbered(
        mavlink.MAVLink_set_attitude_target_message(
            0, SYSTEM, COMPONENT, mask, list(q), 0, 0, rate, thrust
        )
    )


def manual_control(z: int = 0, y: int = 0, x: int = 0, r: int = 0, target: int = 1) -> MavMessage:
    """Return a MANUAL_CONTROL."""
    return numbered(mavlink.MAVLink_manual_control_message(target, x, y, z, r, 0))


def rc_override(*channels: int, upper: int = 0) -> MavMessage:
    """Return an RC_CHANNELS_OVERRIDE; channels that are not given are left."""
    lower = (*channels, *(0xFFFF,) * (8 - len(channels)))
    return numbered(
        mavlink.MAVLink_rc_channels_override_message(SYSTEM, COMPONENT, *lower, *(upper,) * 10)
    )
