"""Invariants of what is kept: what an operator was told is saved is there after a restart."""

from collections import defaultdict
from typing import Any, Final

from protocol.wire.enums import MissionType
from protocol.wire.message import Message
from protocol.wire.messages import MissionClearAll, MissionItemInt, ParamSet
from protocol.wire.packing import wire_of
from robot.core import states
from robot.core.safety import fence as fences
from robot.mission.waypoint import stop_of
from robot.vehicle import Vehicle
from verification.simulation.hosts.operators import Asked
from verification.simulation.invariants.shared import Facts

Items = tuple[MissionItemInt, ...]
ITEMS: Final = (MissionType.FENCE, MissionType.MISSION)


class Value:
    """Values of one thing in the order in which the robot took them, the oldest still possible
    after a restart first."""

    def __init__(self, first: object) -> None:
        self.possible = [repr(first)]

    def taken(self, value: object) -> None:
        self.possible.append(repr(value))

    def acknowledged(self, value: object) -> bool:
        """Only this one or later ones are possible from now on; False if it was never taken."""
        text = repr(value)
        if text not in self.possible:
            return False
        del self.possible[: self.possible.index(text)]
        return True


class Keeping:
    """Follows parameters, mission and fence from request to acknowledgement to restart."""

    def __init__(self, facts: Facts) -> None:
        self._facts = facts
        self._params: dict[str, Value] = {}
        self._items: defaultdict[int, Value] = defaultdict(lambda: Value(()))
        self._seen: dict[int, Items] = {}
        self._last_mission: Items = ()
        self._fence_lost = False

    def restored(self, vehicle: Vehicle) -> None:
        """The robot has started again and put up what it has found."""
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
        """A mission that leaves the fence is not put up again."""
        fence = vehicle.state.machine.fence
        if kind != MissionType.MISSION or fence is None or items:
            return False
        goals = [stop_of(item).goal for item in self._last_mission]
        return not all(fences.inside(fence, goal.x_m, goal.y_m) for goal in goals)

    def _fail(self, name: str, found: str, value: Value) -> None:
        wanted = " or ".join(one[:60] for one in value.possible)
        self._facts.fail(
            "acknowledged survives", f"{name} is {found} after a restart, not {wanted}"
        )

    def damaged(self, name: str) -> None:
        """A file cannot be read any more: what was in it is lost."""
        if name == "parameters":
            assert self._facts.robot is not None
            for param, value in self._params.items():
                value.taken(float(getattr(self._facts.robot.params, param)))
            return
        kind = MissionType[name.upper()]
        self._items[kind].taken(())
        self._fence_lost = self._fence_lost or kind == MissionType.FENCE

    def cycled(self, vehicle: Vehicle) -> None:
        """Without the fence that it had, a robot is not armed until there is another one."""
        if self._fence_lost and vehicle.state.machine.vehicle == states.ACTIVE:
            self._facts.fail("no fence is forgotten", "armed; its fence was damaged on the disk")

    def received(self, vehicle: Vehicle, request: Message) -> None:
        """A request was acted upon: note what it has changed."""
        if isinstance(request, ParamSet) and hasattr(vehicle.params, request.param_id):
            name = request.param_id
            value = float(getattr(vehicle.params, name))
            if name not in self._params:
                assert self._facts.robot is not None
                self._params[name] = Value(float(getattr(self._facts.robot.params, name)))
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

    def told(self, asked: Asked) -> None:
        """An operator was told that something is done."""
        if not asked.answered or asked.action not in ("param", "fence", "fence off", "mission"):
            return
        first, second = asked.content
        if asked.action == "param":
            done = first in self._params and self._params[first].acknowledged(float(second))
        else:
            done = self._items[first].acknowledged(tuple(travelled(item) for item in second))
        if not done:
            self._facts.fail("acknowledged is done", f"{asked.action} {first}: never taken")


def travelled(item: MissionItemInt) -> Message:
    """The item as it arrives: floats have 32 bits on the wire."""
    wire = wire_of(MissionItemInt)
    return wire.unpack(wire.pack(item))


def held(vehicle: Vehicle, kind: int) -> Items:
    transfers: Any = vehicle._transfers
    items: Items = transfers._held[kind].items
    return items
