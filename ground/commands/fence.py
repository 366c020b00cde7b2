"""The fence: a circle or polygon that the robot does not leave, and that all goals must lie in."""

from dataclasses import dataclass
from typing import ClassVar

from ground.client.missions import TransferOutcome
from ground.client.outcomes import Refused, Success
from ground.missions.mission import Circle, Fence
from ground.robot import Robot


@dataclass(frozen=True, slots=True, kw_only=True)
class SetFence:
    """Keep the robot inside a circle or polygon (metres, in the robot's own frame)."""

    moves: ClassVar[bool] = True
    fence: Fence

    @property
    def verb(self) -> str:
        """The verb, with the kind of the fence."""
        return f"fence {'circle' if isinstance(self.fence, Circle) else 'polygon'}"

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Upload the fence and return the robot's verdict."""
        return await robot.fence.set(self.fence)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClearFence:
    """Remove the fence."""

    verb: ClassVar[str] = "fence off"
    moves: ClassVar[bool] = True

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Delete the fence from the robot and return its verdict."""
        return await robot.fence.clear()


@dataclass(frozen=True, slots=True)
class FenceShown(Success):
    """The robot's fence, None if it has none."""

    fence: Fence | None

    @property
    def text(self) -> str:
        """The fence with all its corners, in words."""
        return "no fence" if self.fence is None else in_words(self.fence)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the fence as a row: centre and radius, or corners, in metres."""
        row: dict[str, object] = {"verb": verb, "robot": robot, "ok": True, "fence": None}
        fence = self.fence
        if isinstance(fence, Circle):
            row["fence"] = {"x_m": fence.x_m, "y_m": fence.y_m, "radius_m": fence.radius_m}
        elif fence is not None:
            row["fence"] = {"corners": [list(corner) for corner in fence.corners]}
        return row


@dataclass(frozen=True, slots=True, kw_only=True)
class ShowFence:
    """Read the robot's fence."""

    verb: ClassVar[str] = "fence show"
    moves: ClassVar[bool] = False

    async def perform(self, robot: Robot) -> FenceShown | TransferOutcome:
        """Download the fence; a verdict if the robot does not send it."""
        found = await robot.fence.download()
        return found if isinstance(found, TransferOutcome) else FenceShown(found)


def in_words(fence: Fence) -> str:
    """Describe a fence with all its corners."""
    if isinstance(fence, Circle):
        return str(fence)
    return f"{fence}: {' '.join(f'({x:g}, {y:g})' for x, y in fence.corners)}"
