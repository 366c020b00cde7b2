"""`arm`: allow the wheels to turn."""

from ground.client.outcomes import Answer
from ground.commands.command import TimedCommand, command
from ground.robot import Robot
from runtime.cli.verb import DRIVE


@command(DRIVE, 90, "arm", moves=True)
class Arm(TimedCommand):
    """Arm the motors."""

    effect = "motors armed"

    async def perform(self, robot: Robot) -> Answer:
        """Send it and return the robot's answer."""
        return await robot.arm(timeout_s=self.timeout_s)
