"""Remember how to take back goals, and changes of parameters, of the fence and of the draft."""

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import hypot, isfinite
from typing import Any, Final, NamedTuple, TypeAlias

from ground.client.goal import Destination
from ground.client.outcomes import Outcome, Refused
from ground.client.parameter import Parameter
from ground.client.parameters import ParametersLoaded
from ground.commands.abort import Abort
from ground.commands.command import OperatorCommand, command
from ground.commands.fence import ClearFence, FenceShown, SetFence, SetFenceOfFile, ShowFence
from ground.commands.goto import Goto
from ground.commands.param import LoadParameters, ResetParameter, SetParameter
from ground.missions.mission import Mission
from ground.robot import Robot
from ground.station.robot.command_queue import JobResult
from ground.station.station import Station
from protocol.topics import MISSION, STATUS
from protocol.wire.enums import GoalState, MissionState, Mode
from protocol.wire.messages import NavigatorStatus
from runtime.errors import UserError

MAX_CHANGES: Final = 50
FENCES: Final = (SetFence, SetFenceOfFile, ClearFence)
CHANGES: Final = (SetParameter, ResetParameter, Goto, *FENCES)
UNDONE: Final = (*CHANGES, LoadParameters)
"""Commands that can be taken back; the last one perhaps in part."""

NO_CHANGE: Final = "no goal was set here, and no parameter, fence or draft was changed"
SAME_PLACE_M: Final = 0.01
UNDER_WAY: Final = (MissionState.RUNNING, MissionState.HOLDING)
NEW_WORLD: Final = "nothing was changed since the world was started"
Back: TypeAlias = OperatorCommand | Mission


class Change(NamedTuple):
    """A change: the robot, the line that made it, and the operation that undoes it.

    A mission is the draft before the change. None: the state before it is not known.
    """

    robot: str
    line: str
    back: Back | None


@command(word="set back", moves=True)
class RestoreParameters(OperatorCommand):
    """Set parameters back to these values, by name."""

    values: tuple[tuple[str, float], ...]

    @property
    def line(self) -> str:
        """The description for the log."""
        return f"set back {', '.join(name for name, _ in self.values)}"

    async def perform(self, robot: Robot) -> ParametersLoaded | Refused:
        """Set the values that differ, until one is refused."""
        return await robot.parameters.restore(dict(self.values))


class UndoList:
    """The newest changes."""

    def __init__(self, changes: Iterable[Change] = (), nothing: str = NO_CHANGE) -> None:
        self._changes = deque(changes, maxlen=MAX_CHANGES)
        self._nothing = nothing
        self._goals: dict[str, Goto] = {}
        """The last goal that was sent to each robot, whose status does not show the tolerances."""

    def in_new_world(self, *, keeps_draft: bool) -> "UndoList":
        """Return a list without the changes of robots.

        Changes of the draft remain if the draft remains.

        A request that is still pending adds its change to this list, which is no longer used.
        """
        kept = (one for one in self._changes if keeps_draft and isinstance(one.back, Mission))
        return UndoList(kept, NEW_WORLD)

    def add(self, change: Change) -> None:
        """Append a change."""
        self._changes.append(change)

    def note(
        self,
        robot: str,
        line: str,
        operation: OperatorCommand,
        outcome: Outcome,
        back: Back | None,
    ) -> None:
        """Append the change that an operation has made, if any, with its inverse."""
        if isinstance(outcome, ParametersLoaded):  # perhaps only some of them
            if outcome.before:
                self.add(Change(robot, line, RestoreParameters(values=outcome.before)))
        elif outcome.ok and isinstance(operation, CHANGES):
            self.add(Change(robot, line, back))
            if isinstance(operation, Goto):
                self._goals[robot] = operation

    @property
    def newest(self) -> Change | None:
        """The change that is taken back next."""
        return self._changes[-1] if self._changes else None

    def goal_before(self, station: Station) -> OperatorCommand | None:
        """Return the operation that restores the present goal of the robot that is shown.

        That is an abort without a goal. None if it is not known, or drives a mission.
        """
        status = station.telemetry.live(STATUS, station.now_ns)
        mission = station.telemetry.live(MISSION, station.now_ns)
        is_mission = mission is not None and mission.state in UNDER_WAY
        if status is None or is_mission or status.mode == Mode.SMART_RTL:
            return None
        if status.goal == GoalState.NONE or not isfinite(status.goal_x_m):
            return Abort()
        sent = self._goals.get(station.robot)
        if sent is not None and is_same_place(sent, status):
            return sent
        turned_rad = status.goal_heading_rad if isfinite(status.goal_heading_rad) else None
        place = Destination(x_m=status.goal_x_m, y_m=status.goal_y_m, heading_rad=turned_rad)
        return Goto(goal=place)

    def take(self, robot: str) -> Change:
        """Remove and return the newest change; UserError if it is of another robot.

        A change that cannot be undone is removed, too, with a UserError.
        """
        if not self._changes:
            raise UserError(f"nothing to undo: {self._nothing}")
        newest = self._changes[-1]
        if newest.robot != robot and not isinstance(newest.back, Mission):
            raise UserError(
                f"the last change is of {newest.robot}: {newest.line}; select {newest.robot} first"
            )
        self._changes.pop()
        if newest.back is None:
            raise UserError(f"{newest.line} cannot be undone: the state before it is unknown")
        return newest


def is_same_place(sent: Goto, status: NavigatorStatus) -> bool:
    """Return whether a status shows a goal that was sent in the world frame."""
    goal = sent.goal
    if goal is None or sent.seen_by_robot:
        return False
    return hypot(goal.x_m - status.goal_x_m, goal.y_m - status.goal_y_m) <= SAME_PLACE_M


async def inverse_of(
    operation: OperatorCommand, parameters: Iterable[Parameter], robot: Robot
) -> OperatorCommand | None:
    """Return the operation that restores the present state; None if that is unknown.

    The fence is read from the robot, because others may have changed it.
    """
    if isinstance(operation, SetParameter | ResetParameter):
        before = next((one.value for one in parameters if one.name == operation.name), None)
        return None if before is None else SetParameter(name=operation.name, value=before)
    if isinstance(operation, FENCES):
        shown = await ShowFence().perform(robot)
        if not isinstance(shown, FenceShown):
            return None
        return ClearFence() if shown.fence is None else SetFence(fence=shown.fence)
    return None


@dataclass(slots=True)
class Undoable:
    """The witness of a command that `undo` takes back; `back` is how."""

    command: OperatorCommand
    line: str
    changes: UndoList
    station: Station
    back: Back | None = None

    async def before(self, robot: Robot) -> None:
        """Note how to take it back, on the robot that was shown when it was given."""
        is_shown = self.station.robot == robot.name
        if isinstance(self.command, Goto):
            self.back = self.changes.goal_before(self.station) if is_shown else None
        else:
            parameters = self.station.parameters or () if is_shown else ()
            self.back = await inverse_of(self.command, parameters, robot)

    def after(self, robot: Robot, outcome: Outcome) -> None:
        """Append the change, if it was made."""
        self.changes.note(robot.name, self.line, self.command, outcome, self.back)


@dataclass(frozen=True, slots=True)
class Restore:
    """Restores the state before a change; after a refusal the change can be undone again."""

    changes: UndoList
    change: Change

    async def perform(self, robot: Robot) -> Outcome:
        """Perform what takes it back."""
        back: Any = self.change.back
        assert back is not None, "refused by take()"
        assert not isinstance(back, Mission), "the draft is restored without a request"
        outcome: Outcome = await back.perform(robot)
        if not outcome.ok:
            self.changes.add(self.change)
        return outcome


@dataclass(frozen=True, slots=True)
class TakeBack:
    """Takes back the newest change of when its turn comes."""

    changes: UndoList
    robot: str
    restore_draft: Callable[[Change, Mission], str]

    async def perform(self, robot: Robot) -> JobResult:
        """Restore what it was; UserError if there is nothing."""
        change = self.changes.take(self.robot)
        if isinstance(change.back, Mission):
            return JobResult(True, self.restore_draft(change, change.back))
        outcome = await Restore(self.changes, change).perform(robot)
        return JobResult(outcome.ok, f"{change.line}: {outcome.text}")
