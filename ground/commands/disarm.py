"""`disarm`: block the wheels."""

from ground.commands.command import command
from ground.commands.plain import Parts, PlainCommand
from protocol.wire.enums import Command
from runtime.cli.verb import DRIVE


@command(DRIVE, 100, "disarm", only_stops=True)
class Disarm(PlainCommand):
    """Disarm the motors."""

    effect = "motors disarmed"
    parts = Parts(Command.COMPONENT_ARM_DISARM, 0.0)
