"""The protocols of a vehicle, in the order in which they are called."""

from pathlib import Path

from ground.gateway.commands.operator_control import OperatorCommands
from ground.gateway.commands.service import CommandService
from ground.gateway.files.wiring import parameters_and_files
from ground.gateway.missions.wiring import missions_of
from ground.gateway.motion.wiring import motion_of
from ground.gateway.signing.guard import SigningGuard
from ground.gateway.signing.setup import SigningSetup
from ground.gateway.streams.wiring import streams_of
from ground.gateway.traffic import MavService
from ground.gateway.vehicle import Face, Vehicle


def face_of(
    vehicle: Vehicle, recordings: Path | None = None, guard: SigningGuard | None = None
) -> Face:
    """Return the face of a vehicle, with all its protocols.

    `recordings` is their folder. Without a `guard` clients cannot set a signing key.
    """
    motion, streams = motion_of(vehicle), streams_of(vehicle)
    missions, control = missions_of(vehicle), OperatorCommands(vehicle)
    tables = (*motion.tables, *streams.tables, *missions.tables, control.table)
    services: list[MavService] = [
        *streams.services,
        *motion.services,
        *missions.services,
        control,
        CommandService(vehicle, *tables),
        *parameters_and_files(vehicle, recordings),
    ]
    if guard is not None:
        services.append(SigningSetup(vehicle, guard))
    return Face(vehicle, services)
