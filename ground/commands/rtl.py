"""`rtl`: drive back along the trail."""

from ground.commands.command import command
from ground.commands.plain import Parts, PlainCommand
from protocol.wire.enums import Command
from runtime.cli.verb import DRIVE


@command(DRIVE, 80, "rtl", moves=True, begins=True)
class ReturnHome(PlainCommand):
    """Drive back along the robot's own trail."""

    effect = "driving back along the trail"
    parts = Parts(Command.NAV_RETURN_TO_LAUNCH)
