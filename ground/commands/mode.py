"""`mode`: choose the mode."""

from ground.client.outcomes import Answer
from ground.client.vocabulary import MODE_SUMMARIES
from ground.commands.command import TimedCommand, choice, command
from ground.robot import Robot
from protocol.wire.enums import Mode
from runtime.cli.verb import DRIVE

MODES = {mode.name.lower(): mode for mode in Mode}


@command(DRIVE, 130, "mode auto", moves=True, begins=True)
class SetMode(TimedCommand):
    """Choose the mode."""

    effect = "mode set"
    mode: Mode = choice(MODES, help=", ".join(MODES), meanings=MODE_SUMMARIES)

    @property
    def moves(self) -> bool:
        """False for HOLD: it can only stop the robot."""
        return self.mode is not Mode.HOLD

    async def perform(self, robot: Robot) -> Answer:
        """Send it and return the robot's answer."""
        return await robot.set_mode(self.mode, timeout_s=self.timeout_s)
