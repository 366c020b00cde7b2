"""The plans to upload and download: a mission, whose item 0 is home, and a fence."""

from collections.abc import Sequence
from contextlib import suppress
from math import dist
from typing import Any, Final, Generic, NamedTuple, Protocol, TypeVar

from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.missions.plan_items import (
    Corner,
    PlanId,
    fence_id,
    fence_items,
    fence_of_corners,
    mission_id,
)
from gateways.mavlink.robot_copy import Key, RobotCopy
from gateways.mavlink.robot_port import Answered
from ground.client.missions import TransferOutcome
from ground.client.outcomes import Operation
from ground.commands.fence import ClearFence, FenceShown, SetFence, ShowFence
from ground.commands.mission import ClearMission, FetchMission, MissionFetched, UploadMission
from ground.missions.mission import Fence, Mission, Step, Waypoint
from ground.missions.qgroundcontrol import (
    Item,
    UnsupportedItemError,
    item_of,
    place_in,
    step_of,
)
from protocol.wire.enums import FRAME_GLOBAL, Command, MissionType


def mission_copy(vehicle: MavVehicle) -> RobotCopy[tuple[Step, ...]]:
    """Return the copy of a robot's mission; its status shows a change."""

    def key() -> Key | None:
        status = vehicle.snapshot.mission
        return None if status is None else (status.mission_id, status.count)

    return RobotCopy(vehicle, FetchMission(), steps_in, key)


def steps_in(answered: Answered) -> tuple[Step, ...] | None:
    """Return the steps that the robot has sent, None if it has not answered."""
    outcome = answered.outcome
    if isinstance(outcome, MissionFetched):
        return outcome.mission.waypoints
    return () if isinstance(outcome, TransferOutcome) and outcome.is_none else None


def fence_copy(vehicle: MavVehicle) -> RobotCopy[tuple[Fence, ...]]:
    """Return the copy of a robot's fence, of which there is at most one."""
    return RobotCopy(vehicle, ShowFence(), fences_in)


def fences_in(answered: Answered) -> tuple[Fence, ...] | None:
    """Return the fence that the robot has sent, None if it has not answered."""
    outcome = answered.outcome
    if not isinstance(outcome, FenceShown):
        return None
    return () if outcome.fence is None else (outcome.fence,)


V = TypeVar("V")
P = TypeVar("P")
HOME: Final = 0
FAR_M: Final = 1.0
"""An item 0 farther from home than this was perhaps meant as a waypoint."""
HOME_NOTE: Final = "mission: item 0 is home, the robot drives from item 1 on"


class PlanChange(NamedTuple, Generic[V]):
    """The operation of an upload, and the robot's values after it."""

    operation: Operation[Any]
    values: tuple[V, ...]


class ItemKind(Protocol[V, P]):
    """One MAV_MISSION_TYPE. `V` are the values that the robot has, `P` the parts of an upload."""

    number: int
    name: str
    type: MissionType
    home_items: int
    copy: RobotCopy[tuple[V, ...]]

    def part_of(self, item: Item, count: int) -> P:
        """Return an item as a part of `count`; UnsupportedItemError if it cannot be one."""

    def note_on(self, item: Item) -> str:
        """Return a hint to the client about an accepted item, empty without one."""

    def change_to(self, parts: Sequence[P]) -> PlanChange[V]:
        """Return the change that an upload requests; UnsupportedItemError if it is invalid."""

    def clearing(self) -> Operation[Any]:
        """Return the operation that deletes all items."""

    def items(self, values: Sequence[V]) -> Sequence[Item]:
        """Return the items to download, from 0."""

    def parts(self, values: Sequence[V]) -> list[P]:
        """Return the parts that would upload what the robot has."""

    def id_of(self, values: Sequence[V]) -> int:
        """Return the opaque id of the robot's values."""

    def accepted(self, values: tuple[V, ...], answered: Answered, now_ns: int) -> None:
        """Store the values that the robot has accepted."""


class MissionKind:
    """The mission. Clients may send any item 0; they receive the robot's home."""

    number = mavlink.MAV_MISSION_TYPE_MISSION
    name = "mission"
    type = MissionType.MISSION
    home_items = 1

    def __init__(self, vehicle: MavVehicle) -> None:
        self.copy: RobotCopy[tuple[Step, ...]] = mission_copy(vehicle)
        self._id = PlanId(mission_id)
        self._vehicle = vehicle

    def part_of(self, item: Item, count: int) -> Step | None:
        """Return the step of an item, None for home."""
        return None if item.number == HOME else step_of(item, self._vehicle.origin)

    def note_on(self, item: Item) -> str:
        """Return a hint if item 0 seems to be meant as a waypoint."""
        vehicle = self._vehicle
        if item.number != HOME or item.command != Command.NAV_WAYPOINT:
            return ""
        with suppress(UnsupportedItemError):
            if dist(place_in(item, vehicle.origin), vehicle.home) > FAR_M:
                return HOME_NOTE
        return ""

    def change_to(self, parts: Sequence[Step | None]) -> PlanChange[Step]:
        """Return the upload of the steps; a mission without any is deleted."""
        steps = tuple(part for part in parts if part is not None)
        if not steps:
            return PlanChange(ClearMission(), ())
        return PlanChange(UploadMission(mission=Mission(waypoints=steps)), steps)

    def clearing(self) -> Operation[Any]:
        """Return the deletion of the mission."""
        return ClearMission()

    def items(self, values: Sequence[Step]) -> Sequence[Item]:
        """Return home and the steps; nothing without steps."""
        if not values:
            return ()
        origin = self._vehicle.origin
        return [self.home, *(item_of(at, one, origin) for at, one in enumerate(values, start=1))]

    @property
    def home(self) -> Item:
        """The item 0."""
        vehicle = self._vehicle
        home = item_of(HOME, Waypoint(x_m=vehicle.home[0], y_m=vehicle.home[1]), vehicle.origin)
        params = (0.0, 0.0, 0.0, 0.0, *home.params[4:6], vehicle.origin_altitude_m)
        return Item(HOME, Command.NAV_WAYPOINT, FRAME_GLOBAL, params)

    def parts(self, values: Sequence[Step]) -> list[Step | None]:
        """Return home and the steps."""
        return [None, *values]

    def id_of(self, values: Sequence[Step]) -> int:
        """Return the opaque id of a mission."""
        return self._id.of(self._vehicle.origin, values)

    def accepted(self, values: tuple[Step, ...], answered: Answered, now_ns: int) -> None:
        """Note the mission that the robot has accepted."""
        outcome = answered.outcome
        number = outcome.verdict.mission_id if isinstance(outcome, TransferOutcome) else 0
        self.copy.adopt(values, (number if values else 0, len(values)), now_ns)


class FenceKind:
    """The fence: one polygon or circle that encloses the robot, and others to stay out of."""

    number = mavlink.MAV_MISSION_TYPE_FENCE
    name = "fence"
    type = MissionType.FENCE
    home_items = 0

    def __init__(self, vehicle: MavVehicle) -> None:
        self.copy: RobotCopy[tuple[Fence, ...]] = fence_copy(vehicle)
        self._id = PlanId(fence_id)
        self._vehicle = vehicle

    def part_of(self, item: Item, count: int) -> Corner:
        """Return the corner or circle of an item."""
        return Corner.of(item, self._vehicle.origin)

    def note_on(self, item: Item) -> str:
        """Return no hint."""
        return ""

    def change_to(self, parts: Sequence[Corner]) -> PlanChange[Fence]:
        """Return the upload of the fence; one without items is deleted."""
        if not parts:
            return PlanChange(ClearFence(), ())
        fence = fence_of_corners(parts)
        return PlanChange(SetFence(fence=fence), (fence,))

    def clearing(self) -> Operation[Any]:
        """Return the deletion of the fence."""
        return ClearFence()

    def items(self, values: Sequence[Fence]) -> Sequence[Item]:
        """Return the items of the fence."""
        return [item for fence in values for item in fence_items(fence, self._vehicle.origin)]

    def parts(self, values: Sequence[Fence]) -> list[Corner]:
        """Return the corners or the circle of the fence."""
        items = self.items(values)
        return [self.part_of(item, len(items)) for item in items]

    def id_of(self, values: Sequence[Fence]) -> int:
        """Return the opaque id of a fence."""
        return self._id.of(self._vehicle.origin, values)

    def accepted(self, values: tuple[Fence, ...], answered: Answered, now_ns: int) -> None:
        """Note the fence that the robot has accepted."""
        self.copy.adopt(values, None, now_ns)
