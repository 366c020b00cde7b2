"""Who is there: the liveliness token of a process, as a key of the bus tells it."""

from typing import NamedTuple


class Presence(NamedTuple):
    """Somebody's liveliness token: the process and its link are there, its loop may hang."""

    robot: str
    role: str
    zid: str


def presence_in(key: str) -> Presence:
    robot, _, role, zid = key.split("/")[-4:]
    return Presence(robot, role, zid)
