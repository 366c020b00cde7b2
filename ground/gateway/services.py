"""The protocols of a vehicle, in the order in which they get messages and time."""

from pathlib import Path

from ground.gateway.commands.service import CommandService
from ground.gateway.files.wiring import parameters_and_files
from ground.gateway.missions.wiring import missions_of
from ground.gateway.motion.wiring import motion_of
from ground.gateway.streams.wiring import streams_of
from ground.gateway.traffic import MavService
from ground.gateway.vehicle import Face, Vehicle


def face_of(vehicle: Vehicle, recordings: Path | None = None) -> Face:
    """Return the face of a vehicle, with all its protocols; `recordings` is their folder."""
    motion, streams = motion_of(vehicle), streams_of(vehicle)
    missions = missions_of(vehicle)
    services: list[MavService] = [
        *streams.services,
        *motion.services,
        *missions.services,
        CommandService(vehicle, *motion.tables, *streams.tables, *missions.tables),
        *parameters_and_files(vehicle, recordings),
    ]
    return Face(vehicle, services)
