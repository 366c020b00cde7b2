"""The fence as mission items: the corners of one polygon, or one circle."""

from typing import Final

from protocol.wire.enums import FRAME_LOCAL_FLU, Command
from protocol.wire.messages import MissionItemInt
from robot.core import reasons
from robot.core.safety.fence import MAX_CORNERS, Fence
from robot.hosting.core import Core
from robot.mission.waypoint import PER_M, tidy

CORNER: Final = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION
CIRCLE: Final = Command.NAV_FENCE_CIRCLE_INCLUSION


class FenceItems:
    """Stores the uploaded `items` of the fence; the core has the fence itself."""

    max_items = MAX_CORNERS

    def __init__(self, core: Core) -> None:
        self.items: tuple[MissionItemInt, ...] = ()
        self._core = core

    def put(self, items: tuple[MissionItemInt, ...]) -> tuple[int | None, int]:
        """Replace the fence; return the index of a bad item, if any, and a reason, 0 if done."""
        kind = items[0].command
        for index, item in enumerate(items):
            reason = problem_of(item, kind, len(items))
            if reason != reasons.OK:
                return index, reason
        refusal = self._core.set_fence(fence_of(items))
        if refusal == reasons.OK:
            self.items = items
        return None, refusal

    def clear(self) -> int:
        """Remove the fence and return a reason, 0 if done."""
        self.items = ()
        return self._core.set_fence(None)


def problem_of(item: MissionItemInt, kind: int, count: int) -> int:
    """Return why an item cannot be part of a fence of this kind, or 0."""
    if item.command not in (CORNER, CIRCLE):
        return reasons.UNKNOWN_COMMAND
    if item.frame != FRAME_LOCAL_FLU:
        return reasons.UNKNOWN_FRAME
    whole = count == 1 if kind == CIRCLE else item.param1 == count
    return reasons.OK if whole and item.command == kind else reasons.FENCE_NOT_SIMPLE


def fence_of(items: tuple[MissionItemInt, ...]) -> Fence:
    """Return the fence that the items describe."""
    radius_m = tidy(items[0].param1) if items[0].command == CIRCLE else 0.0
    xs_m, ys_m = (tuple(place / PER_M for place in places) for places in places_of(items))
    return Fence(xs_m, ys_m, radius_m)


def places_of(items: tuple[MissionItemInt, ...]) -> tuple[list[int], list[int]]:
    """Return the x and y coordinates of the items, in units of 1 / PER_M metres."""
    return [item.x for item in items], [item.y for item in items]
