"""The services that send telemetry, and the commands that they execute."""

from typing import NamedTuple

from gateways.mavlink.commands.service import CommandTable
from gateways.mavlink.streams.clock_sync import ClockSync
from gateways.mavlink.streams.heartbeat import HeartbeatStream
from gateways.mavlink.streams.origin import OriginService
from gateways.mavlink.streams.requests import MessageRequests
from gateways.mavlink.streams.scheduler import StreamScheduler
from gateways.mavlink.streams.silence import SilenceTexts
from gateways.mavlink.streams.texts import RobotTexts
from gateways.mavlink.traffic import MavService
from gateways.mavlink.vehicle import Vehicle


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
