"""The drive that a stop has ended, and how to continue it: goal, mission or way home."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import degrees, isfinite
from typing import Final, Protocol, TypeAlias

from ground.client.goal import Destination
from ground.client.outcomes import Accepted, Refused
from ground.client.vocabulary import GOAL_HINT
from protocol.wire.enums import GoalState, MissionState, Mode
from protocol.wire.messages import MissionStatus, NavigatorStatus
from protocol.wire.reasons import Reason

SAME_M: Final = 0.002
"""Positions closer than this are the same: the wire rounds to millimetres."""
NOTHING: Final = "nothing to resume"
ENDED_GOALS: Final = (GoalState.ABORTED, GoalState.REACHED)


class Place(Protocol):
    """An item of a mission."""

    @property
    def x_m(self) -> float:
        """Position in the world."""

    @property
    def y_m(self) -> float:
        """Position in the world."""


@dataclass(frozen=True, slots=True)
class LostGoal:
    """A goal that ended as ABORTED; `is_auto`: it was driven to without an operator."""

    goal: Destination
    is_auto: bool

    def __str__(self) -> str:
        turn = self.goal.heading_rad
        heading = "" if turn is None else f" {round(degrees(turn)) + 0}"
        return f"{self.goal.x_m:z.2f} {self.goal.y_m:z.2f}{heading}"


@dataclass(frozen=True, slots=True)
class LostMission:
    """A mission that failed on the way to item `current`, counted from 0."""

    current: int
    count: int

    def __str__(self) -> str:
        return f"mission item {self.current + 1} of {self.count}"


@dataclass(frozen=True, slots=True)
class LostReturn:
    """A return along the robot's own trail."""

    def __str__(self) -> str:
        return "the start, along the trail"


LostDrive: TypeAlias = LostGoal | LostMission | LostReturn


def lost_drive(
    status: NavigatorStatus, mission: MissionStatus | None, items: Mapping[int, Place]
) -> LostDrive | None:
    """Return the drive that has been lost, as the robot reports it; None if there is none.

    `items` are those of the mission that have a place, by their numbers from 0.

    A failed mission counts only while the robot's last goal is the mission's current item:
    otherwise another goal came later.
    """
    if mission is not None and has_failed(mission) and is_at(status, items, mission.current):
        return LostMission(mission.current, mission.count)
    x_m, y_m, heading_rad = status.goal_x_m, status.goal_y_m, status.goal_heading_rad
    if status.goal != GoalState.ABORTED or not (isfinite(x_m) and isfinite(y_m)):
        return None
    if status.mode == Mode.SMART_RTL:
        return LostReturn()
    goal = Destination(x_m=x_m, y_m=y_m, heading_rad=heading_rad if isfinite(heading_rad) else None)
    return LostGoal(goal, is_auto=status.mode == Mode.AUTO)


def has_failed(mission: MissionStatus) -> bool:
    """Return whether a mission ended early, and not because a new goal replaced it."""
    return mission.state == MissionState.FAILED and mission.reason != Reason.REPLACED


def is_at(status: NavigatorStatus, items: Mapping[int, Place], current: int) -> bool:
    """Return whether the robot's last goal, now ended, is this item, or the last place before."""
    before = [number for number in items if number <= current]
    if status.goal not in ENDED_GOALS or not before:
        return False
    item = items[max(before)]
    return abs(item.x_m - status.goal_x_m) <= SAME_M and abs(item.y_m - status.goal_y_m) <= SAME_M


@dataclass(frozen=True, slots=True)
class Resumed(Accepted):
    """The robot accepted, and drives on to the drive that was lost."""

    drive: LostDrive

    @property
    def text(self) -> str:
        """Where the robot drives, and the duration."""
        return f"go on to {self.drive}: {Accepted.text.__get__(self)}"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the acceptance as a row, with the lost drive."""
        return Accepted.as_json(self, verb, robot) | {"to": str(self.drive)}


@dataclass(frozen=True, slots=True)
class NothingToResume(Refused):
    """No drive was lost, so that there is nothing to continue; `mission` is the robot's mission."""

    mission: MissionStatus | None = field(default=None, kw_only=True)

    def in_words(self, hints: Mapping[int, str]) -> str:
        """Return that there is nothing, and how to begin the mission, or to set a goal."""
        return self.why(hints)

    def why(self, hints: Mapping[int, str]) -> str:
        """Return the same: a line that tells what was refused needs no other words."""
        mission = self.mission
        begins = None if mission is None else BEGINS.get(mission.state)
        if mission is None or begins is None:
            hint = hints.get(Reason.NO_GOAL, GOAL_HINT)
            return f"{NOTHING}. {self.remedies.addressed(hint)}"
        return f"{NOTHING}: {begins} item {mission.current + 1} of {mission.count}"


BEGINS: Final[Mapping[int, str]] = {
    MissionState.READY: "the mission has not been started: `mission start` begins it at",
    MissionState.DONE: "the mission is done: `mission start` begins it again; it has reached",
    MissionState.FAILED: "the mission has been ended: `mission resume` continues it at",
}
"""What begins a mission that is not under way."""
