"""The fence: a circle or polygon that the robot does not leave, and that all goals must lie in."""

from dataclasses import dataclass
from typing import ClassVar

from ground.client.outcomes import Success
from ground.client.session import Session
from ground.commands.mission import TransferOutcome, fetch, send, send_fence, with_holder
from ground.missions.mission import Circle, Fence
from ground.missions.transfer import Clear, Verdict, fence_of
from protocol.wire.enums import MissionType


@dataclass(frozen=True, slots=True, kw_only=True)
class SetFence:
    """Keep the robot inside a circle or polygon (metres, in the robot's own frame)."""

    moves: ClassVar[bool] = True
    fence: Fence

    @property
    def verb(self) -> str:
        """The verb, with the kind of the fence."""
        return f"fence {'circle' if isinstance(self.fence, Circle) else 'polygon'}"

    def perform(self, session: Session) -> TransferOutcome:
        """Upload the fence and return the robot's verdict."""
        verdict = send_fence(session.link, self.fence)
        return with_holder(session.link, verdict, f"ok, {self.fence}")


@dataclass(frozen=True, slots=True, kw_only=True)
class ClearFence:
    """Remove the fence."""

    verb: ClassVar[str] = "fence off"
    moves: ClassVar[bool] = True

    def perform(self, session: Session) -> TransferOutcome:
        """Delete the fence from the robot and return its verdict."""
        link = session.link
        verdict = send(link, Clear(MissionType.FENCE, link.clock.now_ns()))
        return with_holder(link, verdict, "ok, there is no fence")


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

    def perform(self, session: Session) -> FenceShown | TransferOutcome:
        """Download the fence; a verdict if the robot does not send it."""
        found = fetch(session.link, MissionType.FENCE)
        if isinstance(found, Verdict):
            return with_holder(session.link, found, "no fence")
        return FenceShown(fence_of(found.items))


def in_words(fence: Fence) -> str:
    """Describe a fence with all its corners."""
    if isinstance(fence, Circle):
        return str(fence)
    return f"{fence}: {' '.join(f'({x:g}, {y:g})' for x, y in fence.corners)}"
