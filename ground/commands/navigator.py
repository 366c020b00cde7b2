"""`navigator`: choose the navigator."""

from ground.client.vocabulary import NAVIGATORS, SIDES
from ground.commands.command import choice, command
from ground.commands.plain import Parts, PlainCommand
from protocol.wire.enums import Command, Navigator
from runtime.cli.verb import DRIVE


@command(DRIVE, 140, "navigator bug left", moves=True)
class SetNavigator(PlainCommand):
    """Choose the navigator.

    `side` is 1 for left, -1 for right, 0 to leave it unchanged.
    """

    effect = "navigator set"
    navigator: Navigator = choice(NAVIGATORS)
    side: int = choice(SIDES, default=0, help="side on which obstacles are passed")

    def wire(self) -> Parts:
        """Return the command with navigator and side as its parameters."""
        return Parts(Command.SIDESTEP_SET_NAVIGATOR, float(self.navigator), float(self.side))
