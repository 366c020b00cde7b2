"""Operations that set the pose of a robot."""

from dataclasses import dataclass
from math import nan, radians
from typing import ClassVar, Final

from ground.client.connection import within
from ground.client.goal import FARTHEST_M
from ground.client.outcomes import Answer
from ground.client.session import Session, patience_ns
from ground.commands.command import command
from ground.commands.plain import Parts, PlainCommand
from protocol.topics import TRUTH
from protocol.wire.enums import Command
from runtime.errors import RemoteError

TRUTH_NS: Final = 1_000_000_000
"""Longest wait for the plant's truth."""


@command(word="pose set", moves=True)
class SetPose(PlainCommand):
    """Set the pose of the robot in the world (metres, degrees); refused while a goal is active.

    Without `heading_deg` the robot keeps its heading, if it knows its place.
    `anyway`: send a pose outside of the known world, too.
    """

    x_m: float
    y_m: float
    heading_deg: float | None = None
    anyway: bool = False

    def __post_init__(self) -> None:
        within(self.x_m, -FARTHEST_M, FARTHEST_M, "x", "m")
        within(self.y_m, -FARTHEST_M, FARTHEST_M, "y", "m")
        if self.heading_deg is not None:
            within(self.heading_deg, -360.0, 360.0, "heading", "deg")

    def perform(self, session: Session) -> Answer:
        """Send the pose; UserError for one outside of the known world, unless it is sent anyway."""
        if not self.anyway:
            words = f"pose ({self.x_m:.3f}, {self.y_m:.3f})"
            session.refuse_outside((words, self.x_m, self.y_m))
        return PlainCommand.perform(self, session)

    def wire(self) -> Parts:
        """Return the command with x, y and heading as its parameters."""
        heading_rad = nan if self.heading_deg is None else radians(self.heading_deg)
        return Parts(Command.SIDESTEP_SET_POSE, self.x_m, self.y_m, heading_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class SetTruePose:
    """Set the pose of the robot to the true one, which only a simulated plant publishes."""

    verb: ClassVar[str] = "pose truth"
    moves: ClassVar[bool] = True
    timeout_s: float | None = None

    def perform(self, session: Session) -> Answer:
        """Read the truth and send it; RemoteError if no plant publishes one."""
        link = session.link
        with link.subscribed(TRUTH) as telemetry:
            link.wait(lambda: telemetry.fresh(TRUTH, link.clock.now_ns()) is not None, TRUTH_NS)
            truth = telemetry.fresh(TRUTH, link.clock.now_ns())
        if truth is None:
            fix = "in the real world, or without rights to it, use `pose set X Y DEG`"
            raise RemoteError(f"no simulation publishes the true place of {link.robot}: {fix}")
        pose = truth.x_m, truth.y_m, truth.heading_rad
        patience = patience_ns(self.timeout_s)
        request = link.command(Command.SIDESTEP_SET_POSE, *pose)
        return session.with_holder(link.ask(request, patience_ns=patience))
