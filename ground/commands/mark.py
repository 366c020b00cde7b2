"""`rec mark`: add a remark to the recording."""

from ground.client.outcomes import Marked, Refused
from ground.commands.command import OperatorCommand, command, place
from ground.robot import Robot
from runtime.cli.verb import REC


@command(
    REC,
    30,
    "rec mark the door is closed now",
    moves=True,
    seizes=False,
    also=("record mark",),
)
class Mark(OperatorCommand):
    """Add a remark to the recording.

    Recorders write it, and a replay stops there.
    """

    remark: str = place("TEXT", "the remark", joined=" ".join)

    async def perform(self, robot: Robot) -> Marked | Refused:
        """Publish the remark if a recorder is subscribed to it."""
        return await robot.mark(self.remark)
