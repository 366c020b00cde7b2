"""Presence of processes: parsing and tracking of their liveliness tokens."""

import re
import threading
from collections.abc import Callable
from typing import Final, NamedTuple

from protocol.topic import ROBOT_NAME, Role

ROLES: Final = frozenset(role.value for role in Role)
SESSION: Final = re.compile(r"[0-9a-f]{1,32}\Z")
MAX_TOKENS: Final = 1000
"""Limit of tracked tokens, of all robots together."""


class Presence(NamedTuple):
    """A process's liveliness token: process and link are alive, but its loop may hang."""

    robot: str
    role: str
    zid: str


class TokenSet:
    """The present tokens; `handler` is called for each that appears (True) or disappears (False).

    Zenoh has a thread for each of several links, so tokens may arrive in several threads at once.
    The calls of `handler` never overlap.
    """

    def __init__(self, handler: Callable[[Presence, bool], None]) -> None:
        self.there: frozenset[Presence] = frozenset()
        self._handler = handler
        self._taking = threading.Lock()

    def take(self, token: Presence, *, appeared: bool) -> None:
        """Add or remove a token, unless there are too many; may be called from any thread."""
        with self._taking:
            if appeared and len(self.there) >= MAX_TOKENS:
                return
            self.there = self.there | {token} if appeared else self.there - {token}
            self._handler(token, appeared)

    def clear(self) -> None:
        """Remove all tokens."""
        for token in self.there:
            self.take(token, appeared=False)


def presence_in(key: str) -> Presence | None:
    """Return the token of a key; None unless robot, role and session are valid."""
    robot, _, role, zid = key.split("/")[-4:]
    known = ROBOT_NAME.match(robot) and role in ROLES and SESSION.match(zid)
    return Presence(robot, role, zid) if known else None
