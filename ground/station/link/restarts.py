"""Count restarts of a process, detected by a new token or by a counter that starts again."""

from typing import Final, Literal

from protocol.topics import Role
from runtime.sequence import Order, SequenceTracker
from runtime.units import NS_PER_S

Sign = Literal["token", "count"]
SHOWN_NS: Final = 20 * NS_PER_S
NEAR_NS: Final = 10 * NS_PER_S
"""Largest time between a robot's message about its restart and the detection of it."""
RESTART_PREFIXES: Final = ("restarted: ", "started again: ")
"""Starts of the message of a restarted robot; the cause follows. Old recordings have the second."""


class Restarts:
    """Counts a restart once, although both signs of it appear, in any order.

    A number up to `max_late` behind the newest one is only late.
    """

    def __init__(self, max_late: int = 0) -> None:
        self.count = 0
        self._numbers = SequenceTracker(max_late)
        self._token = ""
        self._expected_sign: Sign | None = None

    def token(self, zid: str) -> bool:
        """Note the token of the process; return True when it shows a restart."""
        if not zid or zid == self._token:
            return False
        first, self._token = not self._token, zid
        return False if first else self._count("token")

    def number(self, number: int) -> bool:
        """Note its tick or time; return True when it shows a restart."""
        return self._numbers.take(number) is Order.RESTARTED and self._count("count")

    def _count(self, sign: Sign) -> bool:
        if self._expected_sign is not None and self._expected_sign != sign:
            self._expected_sign = None
            return False
        self._expected_sign = sign
        self.count += 1
        return True


class RestartNotice:
    """Combines a restart with its `cause`, which the robot reports; empty without a report."""

    def __init__(self, robot: str) -> None:
        self.cause = ""
        self._reported_ns = 0
        self._robot = robot
        self._words = ""
        self._at_ns: int | None = None
        self._role = Role.ROBOT

    def receive(self, text: str, published_ns: int) -> None:
        """Note a text of the robot and the time of its publication."""
        for prefix in RESTART_PREFIXES:
            if text.startswith(prefix):
                self.cause, self._reported_ns = text.removeprefix(prefix), published_ns

    def begin(self, role: Role, times: int, now_ns: int) -> str:
        """Note a restart and return it in words."""
        whose = self._robot if role is Role.ROBOT else f"the plant of {self._robot}"
        self._words = f"{whose} has been restarted ({times})"
        self._role, self._at_ns = role, now_ns
        return self._words

    def words(self, now_ns: int) -> str:
        """Return the restart with its cause while it is recent; otherwise an empty text."""
        if self._at_ns is None or now_ns - self._at_ns > SHOWN_NS:
            return ""
        is_reported = self._role is Role.ROBOT and abs(self._reported_ns - self._at_ns) <= NEAR_NS
        return f"{self._words}: {self.cause}" if is_reported and self.cause else self._words
