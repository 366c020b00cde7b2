"""Restart of the robot's process, for MAVLink clients."""

from ground.client.outcomes import Answer
from ground.commands.command import TimedCommand, command
from ground.robot import Robot


@command(word="restart", moves=True)
class Restart(TimedCommand):
    """End the robot's process, so that its supervisor starts it again; refused while armed."""

    effect = "the robot process restarts"

    async def perform(self, robot: Robot) -> Answer:
        """Send it and return the robot's answer."""
        return await robot.restart(timeout_s=self.timeout_s)
