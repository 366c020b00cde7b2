"""The services that send telemetry, and the commands that they execute."""

from typing import NamedTuple

from ground.gateway.commands.service import CommandTable
from ground.gateway.streams.clock_sync import ClockSync
from ground.gateway.streams.heartbeat import HeartbeatStream
from ground.gateway.streams.origin import OriginService
from ground.gateway.streams.requests import MessageRequests
from ground.gateway.streams.scheduler import StreamScheduler
from ground.gateway.streams.silence import SilenceTexts
from ground.gateway.streams.texts import RobotTexts
from ground.gateway.traffic import MavService
from ground.gateway.vehicle import Vehicle


class StreamServices(NamedTuple):
    """Services, and the tables of their commands."""

    services: tuple[MavService, ...]
    tables: tuple[CommandTable, ...]


def streams_of(vehicle: Vehicle) -> StreamServices:
    """Return the services of one vehicle."""
    scheduler = StreamScheduler(vehicle)
    requests, origin = MessageRequests(vehicle, scheduler), OriginService(vehicle)
    services = (
        HeartbeatStream(vehicle),
        scheduler,
        requests,
        origin,
        ClockSync(vehicle),
        RobotTexts(vehicle),
        SilenceTexts(vehicle),
    )
    return StreamServices(services, (requests.table, origin.table))
