"""Which mission and which fence the robot has, as the map shows them."""

from contextlib import suppress
from math import radians
from typing import NamedTuple

from ground.map import Disc, Outline, Shape, Target
from ground.missions.mission import Circle, Fence, Waypoint
from ground.missions.transfer import MAX_ITEMS, Download, Downloaded
from ground.missions.wire import fence_of, waypoints_of
from ground.station.bus_protocols import ReadableBus
from protocol.topics import MISSION_SERVICE
from protocol.wire.enums import MissionType
from protocol.wire.messages import MissionClearAll, MissionCount, MissionItemInt, MissionVerdict
from protocol.wire.reasons import Reason
from runtime.clock import Clock
from runtime.errors import RemoteError

PATIENCE_S = 0.5
IN_FORCE = (Reason.NONE, Reason.NOT_SAVED)
KINDS = frozenset(MissionType)


class Items(NamedTuple):
    """What was downloaded of one kind."""

    kind: MissionType
    items: tuple[MissionItemInt, ...]


class MissionItems:
    """As downloaded, or as uploaded by anybody in our hearing; a fence of None: there is none."""

    def __init__(self) -> None:
        self.mission: tuple[Target, ...] = ()
        self.fence: Shape | None = None
        self._uploads: dict[int, dict[int, MissionItemInt]] = {}

    def hear(self, message: object) -> None:
        """A frame of somebody's upload, or the robot's word on it."""
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
                self.take(Items(MissionType(kind), tuple(found[at] for at in sorted(found))))

    def take(self, found: Items) -> None:
        """What cannot be shown is not: the Log has said what was uploaded."""
        with suppress(RemoteError):
            if found.kind is MissionType.MISSION:
                self.mission = tuple(map(target_of, waypoints_of(found.items)))
            else:
                self.fence = shape_of(fence_of(found.items))


def shape_of(fence: Fence | None) -> Shape | None:
    if fence is None:
        return None
    if isinstance(fence, Circle):
        return Disc(fence.x_m, fence.y_m, fence.radius_m)
    return Outline(fence.corners)


def target_of(waypoint: Waypoint) -> Target:
    heading_deg = waypoint.heading_deg
    return Target(
        waypoint.x_m,
        waypoint.y_m,
        None if heading_deg is None else radians(heading_deg),
        waypoint.position_tolerance_m,
    )


def downloaded(bus: ReadableBus, clock: Clock, robot: str, kind: MissionType) -> Items:
    """All items, none when the robot has none; RemoteError at the first question unanswered."""
    transfer = Download(kind, clock.now_ns())
    while not transfer.over:
        for send in transfer.due(clock.now_ns()):
            answer = bus.ask(MISSION_SERVICE, send.request, PATIENCE_S, robot=robot)
            transfer.receive(answer, clock.now_ns())
        if not transfer.over:
            clock.sleep_until(transfer.next_ns)
    outcome = transfer.outcome
    if isinstance(outcome, Downloaded):
        return Items(kind, outcome.items)
    raise RemoteError(f"the robot does not tell its {kind.name.lower()}")
