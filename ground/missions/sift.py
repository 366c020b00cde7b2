"""Convert items of a foreign file to waypoints; unsupported ones are rejected or dropped."""

from collections.abc import Iterable
from typing import NamedTuple

from ground.missions.items import Item, UnsupportedItemError, waypoint_of
from ground.missions.mission import Home, Mission, Waypoint
from ground.missions.problems import MissionError, Problem

DROP = "take it out, or use --drop to go without it"


class Foreign(NamedTuple):
    """A mission of another program's file, and what was dropped from it, in words."""

    mission: Mission
    dropped: tuple[str, ...] = ()


class PlanFilter:
    """Accepts supported items and collects the others; `drop` omits those."""

    def __init__(self, file: str, *, drop: bool) -> None:
        self._file = file
        self._drop = drop
        self._refused: list[Problem] = []

    def waypoints(self, items: Iterable[Item | Problem], home: Home | None) -> list[Waypoint]:
        """Return the waypoints; a Problem is an item that could not be parsed."""
        found = []
        for item in items:
            if isinstance(item, Problem):
                self._refused.append(item)
                continue
            try:
                found.append(waypoint_of(item, home))
            except UnsupportedItemError as error:
                self.refuse(f"item {item.number}", str(error))
        return found

    def refuse(self, where: str, reason: str) -> None:
        """Note an item or a part that is not supported."""
        self._refused.append(Problem(where, reason, "" if self._drop else DROP))

    def result(self, mission: Mission) -> Foreign:
        """Return the mission; MissionError for rejected items or without any waypoint."""
        if self._refused and not self._drop:
            raise MissionError(self._file, self._refused)
        if not mission.waypoints:
            problem = Problem("", "no waypoint is left", "the mission needs at least one")
            raise MissionError(self._file, [*self._refused, problem])
        dropped = tuple(f"{problem.where}: {problem.reason}" for problem in self._refused)
        return Foreign(mission, dropped)
