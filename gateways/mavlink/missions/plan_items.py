"""Items of missions and fences, in MISSION_ITEM_INT and MISSION_ITEM; and the opaque id of a plan.

The positions of MISSION_ITEM are 32-bit floats with 24 significant bits: near a longitude of 180
degrees they are multiples of 1.7 m. The parameters of both messages are such floats. A fence is one
polygon or one circle that encloses the robot.
"""

from collections.abc import Callable, Iterable, Sequence
from struct import Struct
from typing import Final, Generic, NamedTuple, TypeVar
from zlib import crc32

import msgspec

from gateways.mavlink.coordinates import place_of
from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from ground.missions.mission import (
    Circle,
    Fence,
    Home,
    Outline,
    Polygon,
    Step,
    fault_of,
    fence_with,
)
from ground.missions.qgroundcontrol import (
    SCALES,
    Item,
    ItemPart,
    UnsupportedItemError,
    place_in,
    same_on_earth,
)
from ground.missions.transfer import (
    CIRCLES,
    DIGITS,
    EXCLUSIONS,
    FLOAT,
    INCLUSIONS,
    corners_of,
    fence_items_of,
    items_of,
    typed,
    whole_place,
)
from protocol.wire.enums import FRAME_GLOBAL
from protocol.wire.messages import MissionItemInt

ITEM: Final = Struct("<HBBii5d")
ORIGIN: Final = Struct("<ii")
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


def mission_id(origin: Home, steps: Sequence[Step]) -> int:
    """Return the id of a mission; 0 without steps."""
    return _id(origin, items_of(steps))


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
    given = (item.param1, item.param2, item.param3, item.param4, item.z)
    kept = [round(FLOAT.unpack(FLOAT.pack(value))[0], DIGITS) for value in given]
    return ITEM.pack(item.command, item.frame, item.autocontinue, item.x, item.y, *kept)


def item_in(message: MavMessage) -> Item:
    """Return the item in a message, with degrees or metres as its place."""
    x, y = message.x, message.y
    if message.get_msgId() == mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT:
        scale = SCALES.get(message.frame, 1)
        x, y = x / scale, y / scale
    given = (message.param1, message.param2, message.param3, message.param4)
    params = (*map(typed, given), x, y, typed(message.z))
    return Item(message.seq, message.command, message.frame, params, message.autocontinue != 0)


def item_message(item: Item, kind: int, sender: Sender, *, is_int: bool) -> MavMessage:
    """Return the message with an item, not marked as the current item."""
    x, y, height_m = item.params[4:]
    goes_on = int(item.autocontinue)
    head = (sender.system, sender.component, item.number, item.frame, item.command, 0, goes_on)
    if is_int:
        place = whole_place(x, item.frame), whole_place(y, item.frame)
        return mavlink.MAVLink_mission_item_int_message(
            *head, *item.params[:4], *place, height_m, kind
        )
    return mavlink.MAVLink_mission_item_message(*head, *item.params, kind)


RETURN_POINT: Final = 5000
ONE: Final = "only one polygon or circle to stay in is supported"


class Corner(NamedTuple):
    """A corner of a polygon of `size` corners, or the centre of a circle of this radius."""

    number: int
    command: int
    size: float
    x_m: float
    y_m: float

    @staticmethod
    def of(item: Item, origin: Home) -> "Corner":
        """Return the corner of an item; UnsupportedItemError if it is none."""
        if item.command not in (*INCLUSIONS, *EXCLUSIONS):
            stops = item.command == RETURN_POINT
            name = (
                "return point: the robot stops at its fence" if stops else "not an item of a fence"
            )
            raise UnsupportedItemError(f"command {item.command} ({name})")
        return Corner(item.number, item.command, item.params[0], *place_in(item, origin))


def fence_of_corners(corners: Sequence[Corner]) -> Fence:
    """Return the fence; UnsupportedItemError names the item at which it is wrong."""
    drawn: list[tuple[bool, Outline]] = []
    at = 0
    while at < len(corners):
        first = corners[at]
        is_inclusion, is_circle = first.command in INCLUSIONS, first.command in CIRCLES
        if is_inclusion and any(stays for stays, _ in drawn):
            raise UnsupportedItemError(f"item {first.number}: {ONE}")
        size = 1.0 if is_circle else first.size
        run = [one for one in corners[at:] if one.number < first.number + size]
        if not is_circle and (len(run) != size or any(one[1:3] != first[1:3] for one in run)):
            words = f"item {first.number}: is not one of {size:g} corners in a row"
            raise UnsupportedItemError(words, ItemPart.PARAM1)
        drawn.append((is_inclusion, _outline(run)))
        at += len(run)
    return fence_with(drawn)


def _outline(corners: Sequence[Corner]) -> Outline:
    first = corners[0]
    places = [(corner.x_m, corner.y_m) for corner in corners]
    try:
        if first.command in CIRCLES:
            table = {"x_m": first.x_m, "y_m": first.y_m, "radius_m": first.size}
            return msgspec.convert(table, Circle)
        polygon = msgspec.convert({"corners": places}, Polygon)
    except msgspec.ValidationError as error:
        raise UnsupportedItemError(f"item {first.number}: {error}", ItemPart.PARAM1) from error
    if fault := fault_of(polygon.corners):
        raise UnsupportedItemError(f"from item {first.number} on: {fault}", ItemPart.SHAPE)
    return polygon


def fence_items(fence: Fence, origin: Home) -> list[Item]:
    """Return the items of a fence."""
    items: list[Item] = []
    for command, size, places in corners_of(fence):
        for place in places:
            params = (size, 0.0, 0.0, 0.0, *same_on_earth(origin, *place), 0.0)
            items.append(Item(len(items), command, FRAME_GLOBAL, params))
    return items
