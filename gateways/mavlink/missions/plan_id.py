"""The opaque id of a plan: a checksum of its items and of its position on Earth."""

from collections.abc import Callable, Iterable, Sequence
from struct import Struct
from typing import Final, Generic, TypeVar
from zlib import crc32

from gateways.mavlink.frames.globe import place_of
from ground.missions.mission import Fence, Home, Waypoint
from ground.missions.wire import DIGITS, fence_items_of, items_of
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
