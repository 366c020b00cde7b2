"""Peers for which there is no place: of these, only the emergency stop is taken."""

from struct import Struct
from typing import Final

from ground.gateway.clients.framing import HEADER_V1, HEADER_V2, Frame
from ground.gateway.dialect import mavlink

MAX_GUESTS: Final = 8
"""A new one pushes out the oldest."""
COMMANDS: Final = (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT)
LAYOUT: Final = Struct("<f24xH")
"""Parameter 1 and the command; both messages have them at the same places."""


def is_emergency_stop(frame: Frame) -> bool:
    """Return whether a frame is a DO_FLIGHTTERMINATION that stops the robot."""
    if frame.number not in COMMANDS:
        return False
    header = HEADER_V1 if frame.is_mavlink1 else HEADER_V2
    payload = frame.data[header : header + frame.data[1]].ljust(LAYOUT.size, b"\0")
    param1, command = LAYOUT.unpack_from(payload)
    return bool(command == mavlink.MAV_CMD_DO_FLIGHTTERMINATION and param1 > 0.5)
