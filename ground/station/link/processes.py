"""Log processes that connect and disconnect, and count their restarts.

A restart is a new token, or a counter that starts again.
"""

from collections.abc import Iterable
from typing import Final, Literal, NamedTuple

from ground.station.bus_protocols import Token
from protocol.topics import Role
from protocol.wire.enums import Severity
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


OTHERS: Final = "another ground station"
NAMED: Final = {
    Role.ROBOT.value: "robot {robot}",
    Role.PLANT.value: "the plant of {robot}",
    Role.DRIVER.value: "the driver of {robot}",
    Role.GROUND.value: f"{OTHERS} for {{robot}}",
}


BURST: Final = 20
LINE_NS: Final = 1_000_000_000


class PresenceChange(NamedTuple):
    """A line for the log and its severity."""

    text: str
    severity: Severity


class LineBudget:
    """Limits lines of the log: `BURST` at once, then one a second."""

    def __init__(self) -> None:
        self._spent_ns = -BURST * LINE_NS

    def take(self, count: int, now_ns: int) -> int:
        """Return how many of `count` lines may be added now."""
        self._spent_ns = max(self._spent_ns, now_ns - BURST * LINE_NS)
        allowed = min(count, max(0, (now_ns - self._spent_ns) // LINE_NS))
        self._spent_ns += allowed * LINE_NS
        return allowed


class PresenceLog:
    """Compares a robot's tokens with those of the previous poll, without this station's own token.

    Tokens that change all the time must not flood the log: after `BURST` lines there is one a
    second, with the number of omitted lines.
    """

    def __init__(self, robot: str, own: str) -> None:
        self._robot = robot
        self._own = own
        self._there: frozenset[tuple[str, str]] = frozenset()
        self._budget = LineBudget()
        self._omitted = 0

    def update(self, present: Iterable[Token], now_ns: int) -> list[PresenceChange]:
        """Compare the tokens and return the lines that the rate limit allows."""
        there = frozenset(
            (token.role, token.zid)
            for token in present
            if token.robot == self._robot and token.zid != self._own and token.role in NAMED
        )
        came, went, self._there = there - self._there, self._there - there, there
        gone = [
            PresenceChange(f"{self._named(role)} has disconnected", _weight(role))
            for role, _ in sorted(went)
        ]
        here = [
            PresenceChange(f"{self._named(role)} has connected", Severity.INFO)
            for role, _ in sorted(came)
        ]
        return self._within_budget([*gone, *here], now_ns)

    def _within_budget(self, changes: list[PresenceChange], now_ns: int) -> list[PresenceChange]:
        room = self._budget.take(len(changes), now_ns)
        if len(changes) > room:  # robot and plant first
            changes.sort(key=lambda one: OTHERS in one.text)
        reported, omitted = changes[:room], len(changes[room:])
        if reported and self._omitted:
            words = f"{self._omitted} more connections or disconnections for {self._robot}"
            reported, self._omitted = [PresenceChange(words, Severity.WARNING), *reported], 0
        self._omitted += omitted
        return reported

    def _named(self, role: str) -> str:
        return NAMED[role].format(robot=self._robot)


def _weight(role: str) -> Severity:
    return Severity.INFO if role == Role.GROUND.value else Severity.WARNING
