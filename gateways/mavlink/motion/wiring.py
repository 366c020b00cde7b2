"""Commands and motion of one vehicle: its services and its rows of the command table."""

from typing import NamedTuple

from gateways.mavlink.commands.arming import ArmingCommands
from gateways.mavlink.commands.driving import DrivingCommands
from gateways.mavlink.commands.guiding import GuidingCommands
from gateways.mavlink.commands.service import CommandTable
from gateways.mavlink.commands.upkeep import UpkeepCommands
from gateways.mavlink.motion.guided_drive import GuidedDrive
from gateways.mavlink.motion.guided_items import GuidedItems
from gateways.mavlink.motion.manual_control import ManualControl
from gateways.mavlink.motion.pilot import Pilot
from gateways.mavlink.motion.setpoint_stream import SetpointStream
from gateways.mavlink.traffic import MavService
from gateways.mavlink.vehicle import Vehicle


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
