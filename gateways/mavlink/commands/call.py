"""A command of a client, in one form for COMMAND_LONG, COMMAND_INT and SET_MODE."""

from math import isfinite, nan
from struct import Struct
from typing import Final, NamedTuple

from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.motion.setpoints import GLOBAL_FRAMES
from gateways.mavlink.traffic import Sender

INT_UNKNOWN: Final = 0x7FFFFFFF
"""The x or y of a COMMAND_INT that is not set."""
CONTENT: Final = Struct("<7dh")


class Call(NamedTuple):
    """A command with its parameters; NaN is a parameter that is not set.

    `x`, `y` and `z` are parameters 5 to 7. `frame` is None for a COMMAND_LONG, whose x and y are
    degrees; those of a COMMAND_INT are degrees times 1e7.
    """

    number: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: float
    y: float
    z: float
    frame: int | None
    sender: Sender
    now_ns: int

    @property
    def content(self) -> bytes:
        """The parameters as bytes, by which NaN equals NaN."""
        frame = -1 if self.frame is None else self.frame
        return CONTENT.pack(*self[1:8], frame)

    @property
    def is_global(self) -> bool:
        """True if x and y are a latitude and a longitude."""
        return self.frame is None or self.frame in GLOBAL_FRAMES

    @property
    def latitude_deg(self) -> float:
        """The latitude; NaN if it is not set."""
        return self.x if self.frame is None else self.x / 1e7

    @property
    def longitude_deg(self) -> float:
        """The longitude; NaN if it is not set."""
        return self.y if self.frame is None else self.y / 1e7


def whole(value: float) -> int | None:
    """Return a parameter that must be a whole number; None if it is not one."""
    return int(value) if isfinite(value) and value == int(value) else None


def is_unset(value: float) -> bool:
    """Return whether a parameter is 0 or NaN: clients send these values in unused parameters."""
    return value == 0.0 or value != value


def call_of(message: MavMessage, sender: Sender, now_ns: int) -> Call:
    """Return the command in a message."""
    if message.get_msgId() == mavlink.MAVLINK_MSG_ID_SET_MODE:
        number, rest = mavlink.MAV_CMD_DO_SET_MODE, (nan,) * 5
        has_mode = message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        mode = float(message.custom_mode) if has_mode else nan
        return Call(number, message.base_mode, mode, *rest, None, sender, now_ns)
    number, one, two = message.command, message.param1, message.param2
    three, four = message.param3, message.param4
    if message.get_msgId() == mavlink.MAVLINK_MSG_ID_COMMAND_LONG:
        x, y, z, frame = message.param5, message.param6, message.param7, None
    else:
        x, y = (nan if value == INT_UNKNOWN else float(value) for value in (message.x, message.y))
        z, frame = message.z, message.frame
    return Call(number, one, two, three, four, x, y, z, frame, sender, now_ns)
