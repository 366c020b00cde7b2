"""The protocols of a vehicle, in the order in which they are called."""

from pathlib import Path

from gateways.mavlink.commands.operator_control import OperatorCommands
from gateways.mavlink.commands.service import CommandService
from gateways.mavlink.files.wiring import parameters_and_files
from gateways.mavlink.missions.wiring import missions_of
from gateways.mavlink.motion.wiring import motion_of
from gateways.mavlink.signing.guard import SigningGuard
from gateways.mavlink.signing.setup import SigningSetup
from gateways.mavlink.streams.wiring import streams_of
from gateways.mavlink.traffic import MavService
from gateways.mavlink.vehicle import Face, Vehicle


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
