"""`disarm`: block the wheels."""

from ground.client.outcomes import Answer
from ground.commands.command import TimedCommand, command
from ground.robot import Robot
from runtime.cli.verb import DRIVE


@command(DRIVE, 100, "disarm", only_stops=True)
class Disarm(TimedCommand):
    """Disarm the motors."""

    effect = "motors disarmed"

    async def perform(self, robot: Robot) -> Answer:
        """Send it and return the robot's answer."""
        return await robot.disarm(timeout_s=self.timeout_s)
