"""`resume`: continue to the goal."""

from ground.client.outcomes import Answer, GoalEnded
from ground.commands.command import TimedCommand, command
from ground.robot import Robot
from runtime.cli.verb import DRIVE


@command(DRIVE, 60, "resume", moves=True, begins=True)
class Resume(TimedCommand):
    """Continue to the goal.

    Also to one that a failsafe, an emergency stop or an abort ended. From a shell it follows a goal
    that needs an operator, as `goto` does, because nobody else sends the heartbeat; ctrl+c holds.
    """

    effect = "driving on"

    async def perform(self, robot: Robot) -> Answer | GoalEnded:
        """Send it and return the robot's answer."""
        return await robot.resume(timeout_s=self.timeout_s)
