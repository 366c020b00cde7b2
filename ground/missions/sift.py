"""Which items of a foreign file become waypoints: all, or all but those the robot cannot do."""

from collections.abc import Iterable
from typing import NamedTuple

from ground.missions.items import Item, Refused, waypoint_of
from ground.missions.mission import Home, Mission, Waypoint
from ground.missions.problems import MissionError, Problem

DROP = "take it out, or use --drop to go without it"


class Foreign(NamedTuple):
    """A mission out of another program's file, and what was left out of it, in words."""

    mission: Mission
    dropped: tuple[str, ...] = ()


class PlanFilter:
    """Takes what can be done, collects what cannot; `drop`: the rest is left out."""

    def __init__(self, file: str, *, drop: bool) -> None:
        self._file = file
        self._drop = drop
        self._refused: list[Problem] = []

    def waypoints(self, items: Iterable[Item | Problem], home: Home | None) -> list[Waypoint]:
        """A Problem among the items is one that could not even be read as an item."""
        found = []
        for item in items:
            if isinstance(item, Problem):
                self._refused.append(item)
                continue
            try:
                found.append(waypoint_of(item, home))
            except Refused as error:
                self.refuse(f"item {item.number}", str(error))
        return found

    def refuse(self, where: str, reason: str) -> None:
        self._refused.append(Problem(where, reason, "" if self._drop else DROP))

    def result(self, mission: Mission) -> Foreign:
        """MissionError when something was refused that may not be dropped, or nothing is left."""
        if self._refused and not self._drop:
            raise MissionError(self._file, self._refused)
        if not mission.waypoints:
            problem = Problem("", "no waypoint is left", "the mission needs at least one")
            raise MissionError(self._file, [*self._refused, problem])
        dropped = tuple(f"{problem.where}: {problem.reason}" for problem in self._refused)
        return Foreign(mission, dropped)
