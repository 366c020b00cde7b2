"""Items in MISSION_ITEM_INT and MISSION_ITEM.

The positions of MISSION_ITEM are 32-bit floats with 24 significant bits: near a longitude of 180
degrees they are multiples of 1.7 m. The parameters of both messages are such floats.
"""

from math import isnan
from typing import Final

from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.frames.globe import PER_DEG, place_of
from gateways.mavlink.traffic import Sender
from ground.missions.items import GLOBAL_FRAMES, Item
from ground.missions.mission import LOOSEST_M
from ground.missions.wire import PER_METRE
from protocol.wire.enums import Command

LOCAL_FRAMES: Final = frozenset(
    {
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_LOCAL_ENU,
        mavlink.MAV_FRAME_LOCAL_OFFSET_NED,
        mavlink.MAV_FRAME_LOCAL_FRD,
        mavlink.MAV_FRAME_LOCAL_FLU,
    }
)


def item_in(message: MavMessage) -> Item:
    """Return the item in a message, with degrees or metres as its place."""
    x, y = message.x, message.y
    if message.get_msgId() == mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT:
        scale = scale_of(message.frame)
        x, y = x / scale, y / scale
    given = (message.param1, message.param2, message.param3, message.param4)
    params = [typed(value) for value in given]
    return Item(message.seq, message.command, message.frame, (*params, x, y, message.z))


def scale_of(frame: int) -> int:
    """Return the factor of x and y in a MISSION_ITEM_INT."""
    if frame in GLOBAL_FRAMES:
        return PER_DEG
    return PER_METRE if frame in LOCAL_FRAMES else 1


def typed(value: float) -> float:
    """Return the decimal number of at most 7 digits that a client has rounded to a 32-bit float."""
    return float(f"{value:.7g}")


def usual(item: Item) -> Item:
    """Return a waypoint that the robot can execute as well as the given one.

    A waiting time of NaN is none. A position within the robot's largest tolerance is also within
    every larger one, such as the 3 m of MAVSDK.
    """
    if item.command != Command.NAV_WAYPOINT:
        return item
    hold_s, tolerance_m, *rest = item.params
    hold_s = 0.0 if isnan(hold_s) else hold_s
    return item._replace(params=(hold_s, min(tolerance_m, LOOSEST_M), *rest))


def item_message(item: Item, kind: int, sender: Sender, *, is_int: bool) -> MavMessage:
    """Return the message with an item at a global position, not marked as the current item."""
    latitude_deg, longitude_deg, height_m = item.params[4:]
    head = (sender.system, sender.component, item.number, item.frame, item.command, 0, 1)
    if is_int:
        place = place_of(latitude_deg, longitude_deg)
        return mavlink.MAVLink_mission_item_int_message(
            *head, *item.params[:4], *place, height_m, kind
        )
    return mavlink.MAVLink_mission_item_message(*head, *item.params, kind)
