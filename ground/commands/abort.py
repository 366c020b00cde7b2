"""`abort`: stop and end the goal."""

from ground.client.outcomes import Answer
from ground.commands.command import TimedCommand, command
from ground.robot import Robot
from runtime.cli.verb import DRIVE


@command(DRIVE, 70, "abort --id r2", only_stops=True)
class Abort(TimedCommand):
    """Stop and end the goal; `resume` can go on to it later."""

    effect = "stopped, the goal is ended; `sidestep resume` would go on to it"

    async def perform(self, robot: Robot) -> Answer:
        """Send it and return the robot's answer."""
        return await robot.abort(timeout_s=self.timeout_s)
