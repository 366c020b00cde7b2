"""`mode`: choose the mode."""

from ground.commands.command import choice, command
from ground.commands.plain import Parts, PlainCommand
from protocol.wire.enums import Command, Mode
from runtime.cli.verb import DRIVE

MODES = {mode.name.lower(): mode for mode in Mode}


@command(DRIVE, 130, "mode auto", moves=True, begins=True)
class SetMode(PlainCommand):
    """Choose the mode."""

    effect = "mode set"
    mode: Mode = choice(MODES, help=", ".join(MODES))

    @property
    def moves(self) -> bool:
        """False for HOLD: it can only stop the robot."""
        return self.mode is not Mode.HOLD

    def wire(self) -> Parts:
        """Return the command with the mode as its second parameter."""
        return Parts(Command.DO_SET_MODE, 1.0, float(self.mode))
