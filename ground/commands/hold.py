"""`hold`: stop and keep the goal."""

from ground.commands.command import command
from ground.commands.plain import Parts, PlainCommand
from protocol.wire.enums import Command
from runtime.cli.verb import DRIVE


@command(DRIVE, 50, "hold", only_stops=True)
class Hold(PlainCommand):
    """Stop and keep the goal."""

    effect = "holding, the goal is kept"
    parts = Parts(Command.DO_PAUSE_CONTINUE, 0.0)
