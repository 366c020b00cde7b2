"""The services for missions and fences, and the commands that they execute."""

from typing import NamedTuple

from gateways.mavlink.commands.service import CommandTable
from gateways.mavlink.missions.current import CurrentItem
from gateways.mavlink.missions.fence_service import FenceService
from gateways.mavlink.missions.kinds import FenceKind, MissionKind
from gateways.mavlink.missions.protocol import MissionProtocol
from gateways.mavlink.missions.reached import ReachedItems
from gateways.mavlink.traffic import MavService
from gateways.mavlink.vehicle import Vehicle


class MissionServices(NamedTuple):
    """Services, and the tables of their commands."""

    services: tuple[MavService, ...]
    tables: tuple[CommandTable, ...]


def missions_of(vehicle: Vehicle) -> MissionServices:
    """Return the services of one vehicle."""
    mission, fence = MissionKind(vehicle), FenceKind(vehicle)
    current, fences = CurrentItem(vehicle, mission, fence), FenceService(vehicle, fence)
    reached = ReachedItems(vehicle, current)
    services = (MissionProtocol(vehicle, mission, fence), current, reached, fences)
    return MissionServices(services, (current.table, fences.table))
