"""Counts restarts of a process: a new token, or a count of its own that begins again."""

from typing import Final, Literal

from protocol.topics import Role
from runtime.sequence import Order, SequenceTracker
from runtime.units import NS_PER_S

Sign = Literal["token", "count"]
SHOWN_NS: Final = 20 * NS_PER_S
NEAR_NS: Final = 10 * NS_PER_S
"""What is told of a restart is told so soon before or after it is noticed."""
TOLD: Final = "restarted: "
"""A robot that is not the first begins with this, and how the one before it ended."""


class Restarts:
    """Both signs of one restart count once, in whichever order they come.

    A number up to `max_late` behind the newest only came late.
    """

    def __init__(self, max_late: int = 0) -> None:
        self.count = 0
        self._numbers = SequenceTracker(max_late)
        self._token = ""
        self._owed: Sign | None = None

    def token(self, zid: str) -> bool:
        """Its token is there; True when that shows a restart."""
        if not zid or zid == self._token:
            return False
        first, self._token = not self._token, zid
        return False if first else self._counted("token")

    def number(self, number: int) -> bool:
        """Its tick or its time; True when that shows a restart."""
        return self._numbers.take(number) is Order.RESTARTED and self._counted("count")

    def _counted(self, sign: Sign) -> bool:
        if self._owed is not None and self._owed != sign:
            self._owed = None
            return False
        self._owed = sign
        self.count += 1
        return True


class RestartNotice:
    """`cause` is what the robot last told of the one before it; empty when it has told nothing."""

    def __init__(self, robot: str) -> None:
        self.cause = ""
        self._told_ns = 0
        self._robot = robot
        self._words = ""
        self._at_ns: int | None = None
        self._role = Role.ROBOT

    def hear(self, text: str, told_ns: int) -> None:
        """A text of the robot's, and when it was told."""
        if text.startswith(TOLD):
            self.cause, self._told_ns = text.removeprefix(TOLD), told_ns

    def begun(self, role: Role, times: int, now_ns: int) -> str:
        """It has been noticed; in words."""
        whose = self._robot if role is Role.ROBOT else f"the plant of {self._robot}"
        self._words = f"{whose} has been restarted ({times})"
        self._role, self._at_ns = role, now_ns
        return self._words

    def words(self, now_ns: int) -> str:
        """With its cause, while it is news."""
        if self._at_ns is None or now_ns - self._at_ns > SHOWN_NS:
            return ""
        told = self._role is Role.ROBOT and abs(self._told_ns - self._at_ns) <= NEAR_NS
        return f"{self._words}: {self.cause}" if told and self.cause else self._words
