"""Log processes that connect and disconnect."""

from collections.abc import Iterable
from typing import Final, NamedTuple

from ground.station.bus_protocols import Token
from protocol.topics import Role
from protocol.wire.enums import Severity

OTHERS: Final = "another ground station"
NAMED: Final = {
    Role.ROBOT.value: "robot {robot}",
    Role.PLANT.value: "the plant of {robot}",
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
