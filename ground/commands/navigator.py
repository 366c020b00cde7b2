"""`navigator`: choose the navigator."""

from ground.client.outcomes import Answer
from ground.client.vocabulary import NAVIGATOR_SUMMARIES, NAVIGATORS, SIDES
from ground.commands.command import TimedCommand, choice, command
from ground.robot import Robot
from protocol.wire.enums import Navigator
from runtime.cli.verb import DRIVE


@command(DRIVE, 140, "navigator bug left", moves=True, also=("algo",))
class SetNavigator(TimedCommand):
    """Choose the navigator.

    `side` is 1 for left, -1 for right, 0 to leave it unchanged.
    """

    effect = "navigator set"
    navigator: Navigator = choice(NAVIGATORS, meanings=NAVIGATOR_SUMMARIES)
    side: int = choice(SIDES, default=0, help="side on which obstacles are passed")

    async def perform(self, robot: Robot) -> Answer:
        """Send it and return the robot's answer."""
        return await robot.set_navigator(self.navigator, self.side, timeout_s=self.timeout_s)
