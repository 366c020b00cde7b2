"""`rtl`: drive back along the trail."""

from ground.client.outcomes import Answer
from ground.commands.command import TimedCommand, command
from ground.robot import Robot
from runtime.cli.verb import DRIVE


@command(DRIVE, 80, "rtl", moves=True, begins=True, also=("mode rtl",))
class ReturnHome(TimedCommand):
    """Drive back along the robot's own trail."""

    effect = "driving back along the trail"

    async def perform(self, robot: Robot) -> Answer:
        """Send it and return the robot's answer."""
        return await robot.return_home(timeout_s=self.timeout_s)
