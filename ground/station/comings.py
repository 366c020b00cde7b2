"""Who comes and who goes, as lines for the log."""

from collections.abc import Iterable
from typing import Final, NamedTuple

from ground.station.hears import Token
from protocol.enums import Severity
from protocol.topics import Role

NAMED: Final = {
    Role.ROBOT.value: "robot {robot}",
    Role.PLANT.value: "the plant of {robot}",
    Role.GROUND.value: "another ground station for {robot}",
}


class Coming(NamedTuple):
    """One line, and how much it matters."""

    text: str
    severity: Severity


class Comings:
    """Compares the tokens of one robot with those of the time before; our own is none of them."""

    def __init__(self, robot: str, own: str) -> None:
        self._robot = robot
        self._own = own
        self._there: frozenset[tuple[str, str]] = frozenset()

    def see(self, present: Iterable[Token]) -> list[Coming]:
        there = frozenset(
            (token.role, token.zid)
            for token in present
            if token.robot == self._robot and token.zid != self._own and token.role in NAMED
        )
        came, went, self._there = there - self._there, self._there - there, there
        gone = [
            Coming(f"{self._named(role)} is out of sight", _weight(role))
            for role, _ in sorted(went)
        ]
        here = [Coming(f"{self._named(role)} is there", Severity.INFO) for role, _ in sorted(came)]
        return [*gone, *here]

    def _named(self, role: str) -> str:
        return NAMED[role].format(robot=self._robot)


def _weight(role: str) -> Severity:
    return Severity.INFO if role == Role.GROUND.value else Severity.WARNING
