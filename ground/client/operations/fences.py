"""The fence: the circle or polygon that the robot must not leave, and may not be sent out of."""

from dataclasses import dataclass
from typing import ClassVar

from ground.client.operations.missions import TransferOutcome, fetch, judged, send, send_fence
from ground.client.operations.session import Session
from ground.missions.mission import Circle, Fence
from ground.missions.transfer import Clear, Verdict
from ground.missions.wire import fence_of
from protocol.wire.enums import MissionType


@dataclass(frozen=True, slots=True, kw_only=True)
class SetFence:
    """Keep the robot inside of a circle or polygon (metres, in the robot's own frame)."""

    moves: ClassVar[bool] = True
    fence: Fence

    @property
    def verb(self) -> str:
        return f"fence {'circle' if isinstance(self.fence, Circle) else 'polygon'}"

    def perform(self, session: Session) -> TransferOutcome:
        verdict = send_fence(session.link, self.fence)
        return judged(session.link, verdict, f"ok, {self.fence}")


@dataclass(frozen=True, slots=True, kw_only=True)
class ClearFence:
    """Take the fence away."""

    verb: ClassVar[str] = "fence off"
    moves: ClassVar[bool] = True

    def perform(self, session: Session) -> TransferOutcome:
        link = session.link
        verdict = send(link, Clear(MissionType.FENCE, link.clock.now_ns()))
        return judged(link, verdict, "ok, there is no fence")


@dataclass(frozen=True, slots=True)
class FenceShown:
    """The robot's fence, None when it has none."""

    fence: Fence | None

    @property
    def ok(self) -> bool:
        return True

    @property
    def text(self) -> str:
        return "no fence" if self.fence is None else in_words(self.fence)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        row: dict[str, object] = {"verb": verb, "robot": robot, "ok": True, "fence": None}
        fence = self.fence
        if isinstance(fence, Circle):
            row["fence"] = {"x_m": fence.x_m, "y_m": fence.y_m, "radius_m": fence.radius_m}
        elif fence is not None:
            row["fence"] = {"corners": [list(corner) for corner in fence.corners]}
        return row


@dataclass(frozen=True, slots=True, kw_only=True)
class ShowFence:
    """Read which fence the robot has."""

    verb: ClassVar[str] = "fence show"
    moves: ClassVar[bool] = False

    def perform(self, session: Session) -> FenceShown | TransferOutcome:
        found = fetch(session.link, MissionType.FENCE)
        if isinstance(found, Verdict):
            return judged(session.link, found, "no fence")
        return FenceShown(fence_of(found.items))


def in_words(fence: Fence) -> str:
    """With all its corners."""
    if isinstance(fence, Circle):
        return str(fence)
    return f"{fence}: {' '.join(f'({x:g}, {y:g})' for x, y in fence.corners)}"
