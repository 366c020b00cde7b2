"""Who comes and who goes, as lines for the log."""

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
    """One line, and how much it matters."""

    text: str
    severity: Severity


class PresenceLog:
    """Compares the tokens of one robot with those of the time before; our own is none of them.

    Tokens that come and go all the time may not wash everything else out of the log: beyond
    `BURST` lines there is one a second, and the number of those that were left out.
    """

    def __init__(self, robot: str, own: str) -> None:
        self._robot = robot
        self._own = own
        self._there: frozenset[tuple[str, str]] = frozenset()
        self._spent_ns = -BURST * LINE_NS
        self._unsaid = 0

    def see(self, present: Iterable[Token], now_ns: int) -> list[PresenceChange]:
        there = frozenset(
            (token.role, token.zid)
            for token in present
            if token.robot == self._robot and token.zid != self._own and token.role in NAMED
        )
        came, went, self._there = there - self._there, self._there - there, there
        gone = [
            PresenceChange(f"{self._named(role)} is out of sight", _weight(role))
            for role, _ in sorted(went)
        ]
        here = [
            PresenceChange(f"{self._named(role)} is there", Severity.INFO)
            for role, _ in sorted(came)
        ]
        return self._within_budget([*gone, *here], now_ns)

    def _within_budget(self, news: list[PresenceChange], now_ns: int) -> list[PresenceChange]:
        self._spent_ns = max(self._spent_ns, now_ns - BURST * LINE_NS)
        room = max(0, (now_ns - self._spent_ns) // LINE_NS)
        if len(news) > room:  # of robot and plant first
            news.sort(key=lambda one: OTHERS in one.text)
        told, unsaid = news[:room], len(news[room:])
        self._spent_ns += len(told) * LINE_NS
        if told and self._unsaid:
            words = f"{self._unsaid} more have come or gone for {self._robot}"
            told, self._unsaid = [PresenceChange(words, Severity.WARNING), *told], 0
        self._unsaid += unsaid
        return told

    def _named(self, role: str) -> str:
        return NAMED[role].format(robot=self._robot)


def _weight(role: str) -> Severity:
    return Severity.INFO if role == Role.GROUND.value else Severity.WARNING
