"""One process per role and robot: a duplicate does not start, or is detected later.

`claim` checks once, at the start. A network failure can hide two processes from each other;
`DuplicateWatch` detects them after the network has recovered.
"""

from protocol.bus.bus import Bus
from protocol.bus.presence import Presence
from runtime.errors import UserError


class NameTakenError(UserError):
    """Another process has this role for this robot."""


def claim(bus: Bus, robots: list[str]) -> None:
    """Announce this process, unless another one has its role; of two at once, the smaller id stays.

    Raises NameTakenError, which names the robot and the session of the other process.
    """
    raise_if_taken(bus, duplicates(bus, robots))
    for robot in robots:
        bus.announce(robot)
    raise_if_taken(bus, [(robot, zid) for robot, zid in duplicates(bus, robots) if zid < bus.zid])


class DuplicateWatch:
    """The other processes with this process's role and robot, while they are present."""

    def __init__(self, bus: Bus) -> None:
        self._own = bus.robot, None if bus.role is None else bus.role.value
        self._zid = bus.zid
        self._others: frozenset[str] = frozenset()
        bus.watch(self._see)

    def __bool__(self) -> bool:
        return bool(self._others)

    def _see(self, token: Presence, appeared: bool) -> None:
        """Update the set of duplicates; called in the bus's thread."""
        if (token.robot, token.role) == self._own and token.zid != self._zid:
            other = {token.zid}
            self._others = self._others | other if appeared else self._others - other


def duplicates(bus: Bus, robots: list[str]) -> list[tuple[str, str]]:
    """Return robot and session of each other process with the role of this one."""
    assert bus.role is not None
    return [
        (robot, zid)
        for robot, role, zid in bus.present()
        if role == bus.role.value and robot in robots and zid != bus.zid
    ]


def raise_if_taken(bus: Bus, others: list[tuple[str, str]]) -> None:
    """Raise NameTakenError if there is another process."""
    if others and bus.role is not None:
        robot, zid = others[0]
        raise NameTakenError(
            f"there is a {bus.role.value} for {robot} already (session {zid}): "
            "stop it, or choose another name or endpoint"
        )
