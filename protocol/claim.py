"""One process per role and robot: a second one of a name is told so and does not start."""

from protocol.bus import Bus
from protocol.errors import UserError


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
