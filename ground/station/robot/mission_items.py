"""Keep the mission and the fence of the robot for the map."""

from contextlib import suppress
from math import radians
from typing import NamedTuple

from ground.map import scene
from ground.map.scene import Disc, MapTarget, Shape
from ground.missions.mission import EVERYWHERE, Circle, Fence, Mission, Outline, zones_of
from ground.missions.transfer import MAX_ITEMS, fence_of, waypoints_of
from protocol.wire.enums import MissionType
from protocol.wire.messages import MissionClearAll, MissionCount, MissionItemInt, MissionVerdict
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError

IN_FORCE = (Reason.NONE, Reason.NOT_SAVED)
KINDS = frozenset(MissionType)


class DownloadedItems(NamedTuple):
    """The downloaded items of one kind."""

    kind: MissionType
    items: tuple[MissionItemInt, ...]


class MissionItems:
    """Mission and fence as downloaded, or as uploaded by any operator; empty without one."""

    def __init__(self) -> None:
        self.mission: tuple[MapTarget, ...] = ()
        self.fence: tuple[Shape, ...] = ()
        self._uploads: dict[int, dict[int, MissionItemInt]] = {}

    def receive(self, message: object) -> None:
        """Process a frame of an upload, or the robot's verdict on it."""
        if getattr(message, "mission_type", None) not in KINDS:
            return
        match message:
            case MissionCount(mission_type=kind) | MissionClearAll(mission_type=kind):
                self._uploads[kind] = {}
            case MissionItemInt(mission_type=kind, seq=seq) if seq < MAX_ITEMS:
                self._uploads.setdefault(kind, {})[seq] = message
            case MissionVerdict(reason=reason, mission_type=kind) if (
                reason in IN_FORCE and kind in self._uploads
            ):
                found = self._uploads.pop(kind)
                self.take(
                    DownloadedItems(MissionType(kind), tuple(found[at] for at in sorted(found)))
                )

    def take(self, found: DownloadedItems) -> None:
        """Show a mission or fence; ignore a malformed one."""
        with suppress(RemoteError):
            if found.kind is MissionType.MISSION:
                self.mission = targets_of(Mission(waypoints=waypoints_of(found.items)))
            else:
                self.fence = shapes_of(fence_of(found.items))


def shapes_of(fence: Fence | None) -> tuple[Shape, ...]:
    """Return the outlines of a fence for the map: the one to stay in first, if there is one."""
    if fence is None:
        return ()
    zones = zones_of(fence)
    shown = () if zones.outline == EVERYWHERE else (zones.outline,)
    return tuple(map(_shape, (*shown, *zones.exclusions)))


def _shape(outline: Outline) -> Shape:
    if isinstance(outline, Circle):
        return Disc(outline.x_m, outline.y_m, outline.radius_m)
    return scene.Outline(outline.corners)


def targets_of(mission: Mission) -> tuple[MapTarget, ...]:
    """Return the waypoints of a mission as targets on the map."""
    return tuple(
        MapTarget(
            waypoint.x_m,
            waypoint.y_m,
            None if waypoint.heading_deg is None else radians(waypoint.heading_deg),
            waypoint.position_tolerance_m,
            number,
        )
        for number, waypoint in mission.places
    )
