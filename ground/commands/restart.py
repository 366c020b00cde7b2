"""Restart of the robot's process, for MAVLink clients."""

from ground.commands.command import command
from ground.commands.plain import Parts, PlainCommand
from protocol.wire.enums import Command


@command(word="restart", moves=True)
class Restart(PlainCommand):
    """End the robot's process, so that its supervisor starts it again; refused while armed."""

    effect = "the robot process restarts"
    parts = Parts(Command.PREFLIGHT_REBOOT_SHUTDOWN, 1.0)
