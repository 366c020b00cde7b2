"""Remember how to take back changes of parameters, of the fence and of the mission draft."""

from collections import deque
from collections.abc import Iterable
from typing import Final, NamedTuple, TypeAlias

from ground.client.operations import (
    ClearFence,
    Operation,
    ResetParameter,
    SetFence,
    SetParameter,
    ShowFence,
)
from ground.client.operations.fences import FenceShown
from ground.client.operations.session import Session
from ground.client.parameter import Parameter
from ground.client.results import Outcome
from ground.grammar.fences import SetFenceOfFile
from ground.missions.mission import Mission
from runtime.errors import UserError

MAX_CHANGES: Final = 50
FENCES: Final = (SetFence, SetFenceOfFile, ClearFence)
Back: TypeAlias = Operation[Outcome] | Mission


class Change(NamedTuple):
    """A change: the robot, the line that made it, and what takes it back.

    A mission is the draft before the change.
    """

    robot: str
    line: str
    back: Back


class UndoList:
    """The newest changes."""

    def __init__(self) -> None:
        self._changes: deque[Change] = deque(maxlen=MAX_CHANGES)

    def add(self, change: Change) -> None:
        """Append a change."""
        self._changes.append(change)

    def take(self, robot: str) -> Change:
        """Remove and return the newest change; UserError if it is of another robot."""
        if not self._changes:
            raise UserError("nothing to undo: no parameter, fence or draft was changed here")
        newest = self._changes[-1]
        if newest.robot != robot and not isinstance(newest.back, Mission):
            raise UserError(
                f"the last change is of {newest.robot}: {newest.line}; select {newest.robot} first"
            )
        return self._changes.pop()


def inverse_of(
    operation: Operation[Outcome], parameters: Iterable[Parameter], session: Session
) -> Operation[Outcome] | None:
    """Return the operation that restores the present state; None if that is unknown.

    The fence is read from the robot, because others may have changed it.
    """
    if isinstance(operation, SetParameter | ResetParameter):
        before = next((one.value for one in parameters if one.name == operation.name), None)
        return None if before is None else SetParameter(name=operation.name, value=before)
    if isinstance(operation, FENCES):
        found = ShowFence().perform(session)
        if not isinstance(found, FenceShown):
            return None
        return ClearFence() if found.fence is None else SetFence(fence=found.fence)
    return None
