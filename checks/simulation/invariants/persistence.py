"""Invariants of persistence: an acknowledged change survives a restart."""

from collections import defaultdict
from typing import Any, Final

from checks.simulation.hosts.operators import OperatorRequest
from checks.simulation.invariants import limits
from checks.simulation.invariants.shared import RunState
from protocol.wire.enums import MissionType
from protocol.wire.message import Message, wire_of
from protocol.wire.messages import MissionClearAll, MissionItemInt, ParamSet
from robot.core import states
from robot.mission import stop_of
from robot.vehicle import Vehicle

Items = tuple[MissionItemInt, ...]
ITEMS: Final = (MissionType.FENCE, MissionType.MISSION)


class PossibleValues:
    """The values that a setting may have after a restart, oldest first."""

    def __init__(self, first: object) -> None:
        self.possible = [repr(first)]

    def taken(self, value: object) -> None:
        """Add a value that the robot accepted."""
        self.possible.append(repr(value))

    def acknowledged(self, value: object) -> bool:
        """Drop older values; return False if the value was never accepted."""
        text = repr(value)
        if text not in self.possible:
            return False
        del self.possible[: self.possible.index(text)]
        return True


class PersistenceInvariants:
    """Tracks parameters, mission and fence from request to acknowledgement to restart."""

    def __init__(self, facts: RunState) -> None:
        self._facts = facts
        self._params: dict[str, PossibleValues] = {}
        self._items: defaultdict[int, PossibleValues] = defaultdict(lambda: PossibleValues(()))
        self._seen: dict[int, Items] = {}
        self._last_mission: Items = ()
        self._fence_lost = False

    def restored(self, vehicle: Vehicle) -> None:
        """Check the state that a restarted robot has restored."""
        for name, value in self._params.items():
            found = repr(float(getattr(vehicle.params, name)))
            if found not in value.possible:
                self._fail(name, found, value)
        for kind in ITEMS:
            items = self._seen[kind] = held(vehicle, kind)
            value = self._items[kind]
            if repr(items) not in value.possible and not self._shut_out(vehicle, kind, items):
                self._fail(kind.name.lower(), f"{len(items)} items", value)

    def _shut_out(self, vehicle: Vehicle, kind: int, items: Items) -> bool:
        """Return whether a mission is missing because it leaves the fence."""
        fence = vehicle.state.machine.fence
        if kind != MissionType.MISSION or fence is None or items:
            return False
        goals = [stop_of(item).goal for item in self._last_mission]
        return any(limits.outside_m(*fence, goal.x_m, goal.y_m) > 0.0 for goal in goals)

    def _fail(self, name: str, found: str, value: PossibleValues) -> None:
        wanted = " or ".join(one[:60] for one in value.possible)
        self._facts.fail(
            "acknowledged change survives", f"{name} is {found} after a restart, not {wanted}"
        )

    def damaged(self, name: str) -> None:
        """Record that a file was damaged, so that its content is lost."""
        if name == "parameters":
            assert self._facts.robot is not None
            for param, value in self._params.items():
                value.taken(float(getattr(self._facts.robot.params, param)))
            return
        kind = MissionType[name.upper()]
        self._items[kind].taken(())
        self._fence_lost = self._fence_lost or kind == MissionType.FENCE

    def cycled(self, vehicle: Vehicle) -> None:
        """Check that a robot that lost its fence stays disarmed until it has a new one."""
        if self._fence_lost and vehicle.state.machine.vehicle == states.ACTIVE:
            self._facts.fail(
                "unreadable fence prevents arming",
                "the robot is armed, its fence was damaged on the disk",
            )

    def received(self, vehicle: Vehicle, request: Message) -> None:
        """Record the changes of an answered request."""
        if isinstance(request, ParamSet) and hasattr(vehicle.params, request.param_id):
            name = request.param_id
            value = float(getattr(vehicle.params, name))
            if name not in self._params:
                assert self._facts.robot is not None
                self._params[name] = PossibleValues(float(getattr(self._facts.robot.params, name)))
            self._params[name].taken(value)
        for kind in ITEMS:
            items = held(vehicle, kind)
            cleared = isinstance(request, MissionClearAll) and request.mission_type == kind
            if kind == MissionType.FENCE and (cleared or items is not self._seen.get(kind)):
                self._fence_lost = False
            if items is not self._seen.get(kind):
                self._seen[kind] = items
                if kind == MissionType.MISSION:
                    self._last_mission = items
                self._items[kind].taken(items)

    def ended(self, asked: OperatorRequest) -> None:
        """Check that an acknowledged change was made."""
        if not asked.answered or asked.action not in ("param", "fence", "fence off", "mission"):
            return
        first, second = asked.content
        if asked.action == "param":
            done = first in self._params and self._params[first].acknowledged(float(second))
        else:
            done = self._items[first].acknowledged(tuple(travelled(item) for item in second))
        if not done:
            self._facts.fail(
                "acknowledged request is executed", f"{asked.action} {first}: never accepted"
            )


def travelled(item: MissionItemInt) -> Message:
    """Return an item as it arrives: floats have 32 bits on the wire."""
    wire = wire_of(MissionItemInt)
    return wire.unpack(wire.pack(item))


def held(vehicle: Vehicle, kind: int) -> Items:
    """Return the items that a robot has."""
    transfers: Any = vehicle._transfers
    items: Items = transfers._held[kind].items
    return items
