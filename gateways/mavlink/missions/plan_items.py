"""Items of missions and fences, in MISSION_ITEM_INT and MISSION_ITEM; and the opaque id of a plan.

The positions of MISSION_ITEM are 32-bit floats with 24 significant bits: near a longitude of 180
degrees they are multiples of 1.7 m. The parameters of both messages are such floats. A fence is one
polygon or one circle that encloses the robot.
"""

from collections.abc import Callable, Iterable, Sequence
from math import isnan
from struct import Struct
from typing import Final, Generic, NamedTuple, TypeVar
from zlib import crc32

import msgspec

from gateways.mavlink.coordinates import PER_DEG, place_of
from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from ground.missions.mission import LOOSEST_M, Circle, Fence, Home, Polygon, Waypoint, fault_of
from ground.missions.qgroundcontrol import (
    GLOBAL_FRAMES,
    Item,
    ItemPart,
    UnsupportedItemError,
    place_in,
    to_global,
)
from ground.missions.transfer import DIGITS, fence_items_of, items_of
from protocol.wire.enums import FRAME_GLOBAL, Command
from protocol.wire.limits import PLACES_PER_M
from protocol.wire.messages import MissionItemInt

ITEM: Final = Struct("<Hii4d")
ORIGIN: Final = Struct("<ii")
FLOAT: Final = Struct("<f")
NO_PLAN: Final = 0

V = TypeVar("V")


class PlanId(Generic[V]):
    """The id of the robot's plan, computed once for each plan and origin."""

    def __init__(self, compute: Callable[[Home, Sequence[V]], int]) -> None:
        self._compute = compute
        self._of: tuple[Home, Sequence[V]] | None = None
        self._id = NO_PLAN

    def of(self, origin: Home, values: Sequence[V]) -> int:
        """Return the id of a plan."""
        if self._of is None or self._of[0] is not origin or self._of[1] is not values:
            self._of, self._id = (origin, values), self._compute(origin, values)
        return self._id


def mission_id(origin: Home, waypoints: Sequence[Waypoint]) -> int:
    """Return the id of a mission; 0 without waypoints."""
    return _id(origin, items_of(waypoints))


def fence_id(origin: Home, fences: Sequence[Fence]) -> int:
    """Return the id of a fence; 0 without one."""
    return _id(origin, [item for fence in fences for item in fence_items_of(fence)])


def _id(origin: Home, items: Iterable[MissionItemInt]) -> int:
    packed = b"".join(_packed(item) for item in items)
    if not packed:
        return NO_PLAN
    place = place_of(origin.latitude_deg, origin.longitude_deg)
    return crc32(packed, crc32(ORIGIN.pack(*place))) or 1


def _packed(item: MissionItemInt) -> bytes:
    """Return an item with the rounding of the robot's wire format."""
    given = (item.param1, item.param2, item.param3, item.param4)
    kept = [round(FLOAT.unpack(FLOAT.pack(value))[0], DIGITS) for value in given]
    return ITEM.pack(item.command, item.x, item.y, *kept)


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
    return PLACES_PER_M if frame in LOCAL_FRAMES else 1


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


CORNER: Final = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION
CIRCLE: Final = Command.NAV_FENCE_CIRCLE_INCLUSION
NAMES: Final = {
    5000: "return point: the robot stops at its fence",
    5002: "exclusion polygon: only an inclusion fence is supported",
    5004: "exclusion circle: only an inclusion fence is supported",
}
ONE: Final = "only one polygon or one circle is supported"


class Corner(NamedTuple):
    """A corner of a polygon of `size` corners, or the centre of a circle of this radius."""

    command: int
    size: float
    x_m: float
    y_m: float

    @staticmethod
    def of(item: Item, count: int, origin: Home) -> "Corner":
        """Return the corner of an item of `count`; UnsupportedItemError if it is none."""
        if item.command not in (CORNER, CIRCLE):
            name = NAMES.get(item.command, "not an item of a fence")
            raise UnsupportedItemError(f"command {item.command} ({name})")
        size = item.params[0]
        if item.command == CIRCLE and count != 1:
            raise UnsupportedItemError(f"circle among {count} items: {ONE}")
        if item.command == CORNER and size != count:
            words = f"corner of {size:g} in a fence of {count} items: {ONE}"
            raise UnsupportedItemError(words, ItemPart.PARAM1)
        return Corner(item.command, size, *place_in(item, origin))


def fence_of_corners(corners: Sequence[Corner]) -> Fence:
    """Return the fence; UnsupportedItemError if its values or its outline are wrong."""
    first = corners[0]
    places = [(corner.x_m, corner.y_m) for corner in corners]
    try:
        if first.command == CIRCLE:
            table = {"x_m": first.x_m, "y_m": first.y_m, "radius_m": first.size}
            return msgspec.convert(table, Circle)
        polygon = msgspec.convert({"corners": places}, Polygon)
    except msgspec.ValidationError as error:
        raise UnsupportedItemError(str(error), ItemPart.PARAM1) from error
    fault = fault_of(polygon.corners)
    if fault:
        raise UnsupportedItemError(fault, ItemPart.SHAPE)
    return polygon


def fence_items(fence: Fence, origin: Home) -> list[Item]:
    """Return the items of a fence."""
    if isinstance(fence, Circle):
        command, size, places = CIRCLE, fence.radius_m, [(fence.x_m, fence.y_m)]
    else:
        command, size, places = CORNER, float(len(fence.corners)), list(fence.corners)
    return [
        Item(at, command, FRAME_GLOBAL, (size, 0.0, 0.0, 0.0, *to_global(origin, *place), 0.0))
        for at, place in enumerate(places)
    ]
