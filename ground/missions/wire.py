"""Convert mission and fence to wire items: tenths of a millimetre in the robot's frame."""

from collections.abc import Sequence
from math import isnan, nan
from typing import Final

from ground.missions.mission import Circle, Fence, Polygon, Waypoint
from protocol.wire.enums import FRAME_LOCAL_FLU, Command, MissionType
from protocol.wire.messages import MissionItemInt
from runtime.errors import RemoteError

PER_METRE: Final = 10_000
DIGITS: Final = 5
"""Significant decimals of a typed number after conversion to single precision."""


def items_of(waypoints: Sequence[Waypoint]) -> list[MissionItemInt]:
    """Return the items of waypoints."""
    return [_item(at, waypoint) for at, waypoint in enumerate(waypoints)]


def _item(at: int, waypoint: Waypoint) -> MissionItemInt:
    heading_deg = nan if waypoint.heading_deg is None else waypoint.heading_deg
    return MissionItemInt(
        seq=at,
        frame=FRAME_LOCAL_FLU,
        command=Command.SIDESTEP_NAV_POSE,
        autocontinue=1,
        param1=waypoint.hold_s,
        param2=waypoint.position_tolerance_m,
        param3=waypoint.heading_tolerance_deg,
        param4=heading_deg,
        x=round(waypoint.x_m * PER_METRE),
        y=round(waypoint.y_m * PER_METRE),
        z=0.0,
        mission_type=MissionType.MISSION,
    )


def waypoints_of(items: Sequence[MissionItemInt]) -> tuple[Waypoint, ...]:
    """Return the waypoints of items; RemoteError for an item that is not a pose."""
    for item in items:
        if item.command != Command.SIDESTEP_NAV_POSE or item.frame != FRAME_LOCAL_FLU:
            raise RemoteError(
                f"item {item.seq + 1} of the robot is not a pose: command {item.command}"
            )
    return tuple(
        Waypoint(
            x_m=item.x / PER_METRE,
            y_m=item.y / PER_METRE,
            heading_deg=None if isnan(item.param4) else round(item.param4, DIGITS),
            position_tolerance_m=round(item.param2, DIGITS),
            heading_tolerance_deg=round(item.param3, DIGITS),
            hold_s=round(item.param1, DIGITS),
        )
        for item in items
    )


def fence_items_of(fence: Fence) -> list[MissionItemInt]:
    """Return the items of a fence."""
    if isinstance(fence, Circle):
        around = (fence.x_m, fence.y_m)
        return [_corner(0, Command.NAV_FENCE_CIRCLE_INCLUSION, fence.radius_m, around)]
    command, count = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, float(len(fence.corners))
    return [_corner(at, command, count, place) for at, place in enumerate(fence.corners)]


def _corner(at: int, command: int, param1: float, place: tuple[float, float]) -> MissionItemInt:
    return MissionItemInt(
        seq=at,
        frame=FRAME_LOCAL_FLU,
        command=command,
        param1=param1,
        param2=0.0,
        param3=0.0,
        param4=0.0,
        x=round(place[0] * PER_METRE),
        y=round(place[1] * PER_METRE),
        z=0.0,
        mission_type=MissionType.FENCE,
    )


def fence_of(items: Sequence[MissionItemInt]) -> Fence | None:
    """Return the fence of items, None without items; RemoteError for an unknown kind."""
    if not items:
        return None
    places = tuple((item.x / PER_METRE, item.y / PER_METRE) for item in items)
    kinds = {item.command for item in items}
    if kinds == {Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION}:
        return Polygon(corners=places)
    if kinds == {Command.NAV_FENCE_CIRCLE_INCLUSION} and len(items) == 1:
        x_m, y_m = places[0]
        return Circle(x_m=x_m, y_m=y_m, radius_m=round(items[0].param1, DIGITS))
    raise RemoteError(f"the robot's fence is of an unknown kind: commands {sorted(kinds)}")
