"""`abort`: stop and drop the goal."""

from ground.commands.command import command
from ground.commands.plain import Parts, PlainCommand
from protocol.wire.enums import Command
from runtime.cli.verb import DRIVE


@command(DRIVE, 70, "abort --id r2", only_stops=True)
class Abort(PlainCommand):
    """Stop and drop the goal."""

    effect = "stopped, the goal is dropped"
    parts = Parts(Command.SIDESTEP_ABORT_GOAL)
