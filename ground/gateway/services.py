"""The protocols of a vehicle, in the order in which they get messages and time."""

from ground.gateway.streams.heartbeat import HeartbeatStream
from ground.gateway.streams.scheduler import StreamScheduler
from ground.gateway.traffic import MavService
from ground.gateway.vehicle import Face, Vehicle


def face_of(vehicle: Vehicle) -> Face:
    """Return the face of a vehicle, with all its protocols."""
    services: list[MavService] = [HeartbeatStream(vehicle), StreamScheduler(vehicle)]
    return Face(vehicle, services)
