"""`pose`: tell a robot where it is."""

from dataclasses import dataclass

from ground.client.connection import within
from ground.client.goal import FARTHEST_M
from ground.client.outcomes import Answer
from ground.commands.command import (
    ANYWAY,
    Group,
    OperatorCommand,
    command,
    option,
    place,
    seconds,
    switch,
)
from ground.robot import Robot
from protocol.options import finite
from runtime.cli.verb import MORE

POSE = Group(MORE, 40, "pose set 2 1.5 90", "set the pose of a robot that has lost its place")


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseCommand(OperatorCommand):
    """A command of `pose`; given up after `timeout_s`, None: after the usual attempts."""

    timeout_s: float | None = option(
        "--timeout",
        default=None,
        parse=seconds,
        metavar="S",
        help="give up after this time, in three attempts (default 1.5)",
        after="seize",
    )


@command(POSE, example="pose set 2 1.5 90", moves=True)
class SetPose(PoseCommand):
    """Set the pose of the robot to X Y [DEG].

    Refused while a goal is active. `anyway`: outside of the known world, too.
    """

    x_m: float = place("X", "metres", parse=finite)
    y_m: float = place("Y", "metres", parse=finite)
    heading_deg: float | None = place(
        "DEG",
        "heading; without it the robot keeps its own, if it knows its place",
        default=None,
        parse=finite,
    )
    anyway: bool = switch("--anyway", default=False, help=ANYWAY.format("a pose"))

    def __post_init__(self) -> None:
        within(self.x_m, -FARTHEST_M, FARTHEST_M, "x", "m")
        within(self.y_m, -FARTHEST_M, FARTHEST_M, "y", "m")
        if self.heading_deg is not None:
            within(self.heading_deg, -360.0, 360.0, "heading", "deg")

    async def perform(self, robot: Robot) -> Answer:
        """Send the pose; UserError for one outside of the known world, unless it is sent anyway."""
        if not self.anyway:
            pose = f"pose ({self.x_m:.3f}, {self.y_m:.3f})"
            await robot.refuse_outside((pose, self.x_m, self.y_m))
        return await robot.set_pose(self.x_m, self.y_m, self.heading_deg, timeout_s=self.timeout_s)


@command(POSE, example="pose truth", moves=True)
class SetTruePose(PoseCommand):
    """Set the pose of a simulated robot to the true one."""

    async def perform(self, robot: Robot) -> Answer:
        """Send what the plant publishes; RemoteError if no plant does."""
        return await robot.set_true_pose(timeout_s=self.timeout_s)
