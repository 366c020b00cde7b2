"""The services for missions and fences, and the commands that they execute."""

from typing import NamedTuple

from ground.gateway.commands.service import CommandTable
from ground.gateway.missions.current import CurrentItem
from ground.gateway.missions.fence_service import FenceService
from ground.gateway.missions.kinds import FenceKind, MissionKind
from ground.gateway.missions.protocol import MissionProtocol
from ground.gateway.missions.reached import ReachedItems
from ground.gateway.traffic import MavService
from ground.gateway.vehicle import Vehicle


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
