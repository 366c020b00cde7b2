"""Who is there: the liveliness token of a process, as a key of the bus tells it."""

import re
import threading
from collections.abc import Callable
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


class TokenSet:
    """The tokens that are there; `handler` gets each that comes (True) or goes (False).

    Zenoh has a thread for each of several links, so tokens may come in several threads at once.
    `handler` is called for one after the other.
    """

    def __init__(self, handler: Callable[[Presence, bool], None]) -> None:
        self.there: frozenset[Presence] = frozenset()
        self._handler = handler
        self._taking = threading.Lock()

    def take(self, who: Presence, *, came: bool) -> None:
        """Take note of a token, unless there are too many; may be called from any thread."""
        with self._taking:
            if came and len(self.there) >= MAX_TOKENS:
                return
            self.there = self.there | {who} if came else self.there - {who}
            self._handler(who, came)


def presence_in(key: str) -> Presence | None:
    """The token that a key names; None unless robot, role and session can be some."""
    robot, _, role, zid = key.split("/")[-4:]
    known = ROBOT_NAME.match(robot) and role in ROLES and SESSION.match(zid)
    return Presence(robot, role, zid) if known else None
