"""`arm`: allow the wheels to turn."""

from ground.commands.command import command
from ground.commands.plain import Parts, PlainCommand
from protocol.wire.enums import Command
from runtime.cli.verb import DRIVE


@command(DRIVE, 90, "arm", moves=True)
class Arm(PlainCommand):
    """Arm the motors."""

    effect = "motors armed"
    parts = Parts(Command.COMPONENT_ARM_DISARM, 1.0)
