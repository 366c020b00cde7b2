"""The items of a fence: the corners of one polygon, or one circle, that encloses the robot."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import msgspec

from ground.missions.geography import to_global
from ground.missions.items import Item, ItemPart, UnsupportedItemError, place_in
from ground.missions.mission import Circle, Fence, Home, Polygon
from ground.missions.outline import fault_of
from protocol.wire.enums import FRAME_GLOBAL, Command

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
