"""One process per role and robot: a second one of a name does not start, and is noticed later.

`claim` looks once, at the start. Two processes that a broken network kept apart then meet when it
is whole again: `DuplicateWatch` watches for that.
"""

from protocol.bus.bus import Bus
from protocol.bus.presence import Presence
from runtime.errors import UserError


class NameTaken(UserError):
    """Somebody plays this role for this robot already."""


def claim(bus: Bus, robots: list[str]) -> None:
    """Announce this process, unless its place is taken; of two at once, the smaller id stays.

    Raises NameTaken, which names the robot and the session that is there.
    """
    refuse(bus, twins(bus, robots))
    for robot in robots:
        bus.announce(robot)
    refuse(bus, [(robot, zid) for robot, zid in twins(bus, robots) if zid < bus.zid])


class DuplicateWatch:
    """Other processes in the role of this one for its robot, for as long as they are there."""

    def __init__(self, bus: Bus) -> None:
        self._own = bus.robot, None if bus.role is None else bus.role.value
        self._zid = bus.zid
        self._others: frozenset[str] = frozenset()
        bus.watch(self._see)

    def __bool__(self) -> bool:
        return bool(self._others)

    def _see(self, who: Presence, came: bool) -> None:
        """Called in the bus's thread."""
        if (who.robot, who.role) == self._own and who.zid != self._zid:
            self._others = self._others | {who.zid} if came else self._others - {who.zid}


def twins(bus: Bus, robots: list[str]) -> list[tuple[str, str]]:
    """Robot and session of each other process in the role of this one."""
    assert bus.role is not None
    return [
        (robot, zid)
        for robot, role, zid in bus.present()
        if role == bus.role.value and robot in robots and zid != bus.zid
    ]


def refuse(bus: Bus, others: list[tuple[str, str]]) -> None:
    if others and bus.role is not None:
        robot, zid = others[0]
        raise NameTaken(
            f"there is a {bus.role.value} for {robot} already (session {zid}): "
            "stop it, or choose another name or endpoint"
        )
