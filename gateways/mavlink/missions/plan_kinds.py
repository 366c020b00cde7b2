"""The plans to upload and download: a mission, whose item 0 is home, and a fence.

The gateway keeps a copy of what the robot has, which it reads on demand.
"""

from collections.abc import Callable, Sequence
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
    usual,
)
from gateways.mavlink.robot_port import Answered
from ground.client.session import Operation
from ground.commands.fence import ClearFence, FenceShown, SetFence, ShowFence
from ground.commands.mission import (
    ClearMission,
    FetchMission,
    MissionFetched,
    TransferOutcome,
    UploadMission,
)
from ground.missions.mission import Fence, Mission, Waypoint
from ground.missions.qgroundcontrol import (
    Item,
    UnsupportedItemError,
    item_of,
    place_in,
    waypoint_of,
)
from protocol.wire.enums import FRAME_GLOBAL, Command, MissionType
from runtime.units import NS_PER_S

T = TypeVar("T")
Key = tuple[int, int]
Then = Callable[[tuple[T, ...] | None, str], None]
"""Receives the robot's values, or None with the reason."""

FRESH_NS: Final = NS_PER_S
PERIOD_NS: Final = 10 * NS_PER_S
"""A change of the fence by another operator is read within this time."""
MAX_WAITING: Final = 64
BUSY: Final = "too many requests at once"


class RobotCopy(Generic[T]):
    """The robot's values when they were last read; `values` is None before that.

    `key` returns a value that changes with the robot's data, None if there is none. A copy without
    a key is read again periodically while there are clients.
    """

    def __init__(
        self,
        vehicle: MavVehicle,
        question: Operation[Any],
        parse: Callable[[Answered], tuple[T, ...] | None],
        key: Callable[[], Key | None],
    ) -> None:
        self.values: tuple[T, ...] | None = None
        self._vehicle = vehicle
        self._question = question
        self._parse = parse
        self._key = key
        self._read_key: Key | None = None
        self._asked_key: Key | None = None
        self._read_ns = self._asked_ns = -PERIOD_NS
        self._is_asking = False
        self._waiting: list[Then[T]] = []

    def latest(self, then: Then[T], now_ns: int) -> None:
        """Call `then` with the robot's present values, perhaps in a later round."""
        if self._is_fresh(now_ns):
            then(self.values, "")
        elif len(self._waiting) >= MAX_WAITING:
            then(None, BUSY)
        else:
            self._waiting.append(then)
            self._ask(now_ns)

    def known(self, then: Then[T], now_ns: int) -> None:
        """Call `then` with the values that were last read; read them if there are none."""
        if self.values is None:
            self.latest(then, now_ns)
        else:
            then(self.values, "")

    def adopt(self, values: tuple[T, ...], key: Key | None, now_ns: int) -> None:
        """Store the values that the robot has accepted."""
        self.values, self._read_key = values, key
        self._read_ns = self._asked_ns = now_ns

    def due(self, now_ns: int) -> None:
        """Read the values again if they have changed, or may have changed."""
        vehicle, key = self._vehicle, self._key()
        if not (vehicle.clients and vehicle.snapshot.is_live):
            return
        is_changed = key is not None and key != self._read_key
        period_ns = FRESH_NS if is_changed or self.values is None else PERIOD_NS
        is_unsure = key is None or is_changed
        if is_unsure and now_ns - self._asked_ns >= period_ns:
            self._ask(now_ns)

    def _is_fresh(self, now_ns: int) -> bool:
        if self.values is None:
            return False
        key = self._key()
        recent = now_ns - self._read_ns < FRESH_NS
        return recent if key is None else key == self._read_key

    def _ask(self, now_ns: int) -> None:
        if not self._is_asking:
            self._is_asking = True
            self._asked_ns, self._asked_key = now_ns, self._key()
            self._vehicle.port.perform(self._question, self._read)

    def _read(self, answered: Answered) -> None:
        self._is_asking = False
        waiting, self._waiting = self._waiting, []
        found = self._parse(answered)
        if found is not None:
            self.values = found
            self._read_key, self._read_ns = self._asked_key, self._asked_ns
        for then in waiting:
            then(found, "" if found is not None else answered.text)


def mission_copy(vehicle: MavVehicle) -> RobotCopy[Waypoint]:
    """Return the copy of a robot's mission; its status shows a change."""

    def key() -> Key | None:
        status = vehicle.snapshot.mission
        return None if status is None else (status.mission_id, status.count)

    return RobotCopy(vehicle, FetchMission(), waypoints_in, key)


def waypoints_in(answered: Answered) -> tuple[Waypoint, ...] | None:
    """Return the waypoints that the robot has sent, None if it has not answered."""
    outcome = answered.outcome
    if isinstance(outcome, MissionFetched):
        return outcome.mission.waypoints
    return () if isinstance(outcome, TransferOutcome) and outcome.is_none else None


def fence_copy(vehicle: MavVehicle) -> RobotCopy[Fence]:
    """Return the copy of a robot's fence, of which there is at most one."""
    return RobotCopy(vehicle, ShowFence(), fences_in, lambda: None)


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
    copy: RobotCopy[V]

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
        self.copy: RobotCopy[Waypoint] = mission_copy(vehicle)
        self._id = PlanId(mission_id)
        self._vehicle = vehicle

    def part_of(self, item: Item, count: int) -> Waypoint | None:
        """Return the waypoint of an item, None for home."""
        return None if item.number == HOME else waypoint_of(usual(item), self._vehicle.origin)

    def note_on(self, item: Item) -> str:
        """Return a hint if item 0 seems to be meant as a waypoint."""
        vehicle = self._vehicle
        if item.number != HOME or item.command != Command.NAV_WAYPOINT:
            return ""
        with suppress(UnsupportedItemError):
            if dist(place_in(item, vehicle.origin), vehicle.home) > FAR_M:
                return HOME_NOTE
        return ""

    def change_to(self, parts: Sequence[Waypoint | None]) -> PlanChange[Waypoint]:
        """Return the upload of the waypoints; a mission without any is deleted."""
        waypoints = tuple(part for part in parts if part is not None)
        if not waypoints:
            return PlanChange(ClearMission(), ())
        return PlanChange(UploadMission(mission=Mission(waypoints=waypoints)), waypoints)

    def clearing(self) -> Operation[Any]:
        """Return the deletion of the mission."""
        return ClearMission()

    def items(self, values: Sequence[Waypoint]) -> Sequence[Item]:
        """Return home and the waypoints; nothing without waypoints."""
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

    def parts(self, values: Sequence[Waypoint]) -> list[Waypoint | None]:
        """Return home and the waypoints."""
        return [None, *values]

    def id_of(self, values: Sequence[Waypoint]) -> int:
        """Return the opaque id of a mission."""
        return self._id.of(self._vehicle.origin, values)

    def accepted(self, values: tuple[Waypoint, ...], answered: Answered, now_ns: int) -> None:
        """Note the mission that the robot has accepted."""
        outcome = answered.outcome
        number = outcome.verdict.mission_id if isinstance(outcome, TransferOutcome) else 0
        self.copy.adopt(values, (number if values else 0, len(values)), now_ns)


class FenceKind:
    """The fence: one polygon or circle that encloses the robot."""

    number = mavlink.MAV_MISSION_TYPE_FENCE
    name = "fence"
    type = MissionType.FENCE
    home_items = 0

    def __init__(self, vehicle: MavVehicle) -> None:
        self.copy: RobotCopy[Fence] = fence_copy(vehicle)
        self._id = PlanId(fence_id)
        self._vehicle = vehicle

    def part_of(self, item: Item, count: int) -> Corner:
        """Return the corner or circle of an item."""
        return Corner.of(item, count, self._vehicle.origin)

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
