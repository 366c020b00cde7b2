"""Who is there: the liveliness token of a process, as a key of the bus tells it."""

import re
from typing import Final, NamedTuple

from protocol.topic import ROBOT_NAME, Role

ROLES: Final = frozenset(role.value for role in Role)
SESSION: Final = re.compile(r"[0-9a-f]{1,32}\Z")
MAX_TOKENS: Final = 1000
"""Tokens taken notice of, of all robots together."""


class Presence(NamedTuple):
    """Somebody's liveliness token: the process and its link are there, its loop may hang."""

    robot: str
    role: str
    zid: str


def presence_in(key: str) -> Presence | None:
    """The token that a key names; None unless robot, role and session can be some."""
    robot, _, role, zid = key.split("/")[-4:]
    known = ROBOT_NAME.match(robot) and role in ROLES and SESSION.match(zid)
    return Presence(robot, role, zid) if known else None
