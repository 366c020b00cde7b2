"""Commands and motion of one vehicle: its services and its rows of the command table."""

from typing import NamedTuple

from ground.gateway.commands.arming import ArmingCommands
from ground.gateway.commands.driving import DrivingCommands
from ground.gateway.commands.guiding import GuidingCommands
from ground.gateway.commands.service import CommandTable
from ground.gateway.commands.upkeep import UpkeepCommands
from ground.gateway.motion.guided_drive import GuidedDrive
from ground.gateway.motion.guided_items import GuidedItems
from ground.gateway.motion.manual_control import ManualControl
from ground.gateway.motion.pilot import Pilot
from ground.gateway.motion.setpoint_stream import SetpointStream
from ground.gateway.traffic import MavService
from ground.gateway.vehicle import Vehicle


class MotionParts(NamedTuple):
    """The services and the commands of one vehicle."""

    services: tuple[MavService, ...]
    tables: tuple[CommandTable, ...]


def motion_of(vehicle: Vehicle) -> MotionParts:
    """Return the parts of a vehicle, which share one pilot."""
    pilot = Pilot(vehicle)
    drive = GuidedDrive(vehicle, pilot)
    services = (
        pilot,
        SetpointStream(vehicle, pilot, drive),
        GuidedItems(vehicle, pilot),
        ManualControl(vehicle),
    )
    tables = (
        ArmingCommands(vehicle).table,
        DrivingCommands(vehicle, pilot).table,
        GuidingCommands(vehicle, pilot, drive).table,
        UpkeepCommands(vehicle).table,
    )
    return MotionParts(services, tables)
