"""`hold`: stop and keep the goal."""

from ground.client.outcomes import Answer
from ground.commands.command import TimedCommand, command
from ground.robot import Robot
from runtime.cli.verb import DRIVE


@command(DRIVE, 50, "hold", only_stops=True)
class Hold(TimedCommand):
    """Stop and keep the goal."""

    effect = "holding, the goal is kept"

    async def perform(self, robot: Robot) -> Answer:
        """Send it and return the robot's answer."""
        return await robot.hold(timeout_s=self.timeout_s)
