"""The protocols of a vehicle, in the order in which they are called."""

from pathlib import Path
from typing import NamedTuple

from gateways.mavlink.commands.command_protocol import CommandService, CommandTable
from gateways.mavlink.commands.control_commands import OperatorCommands
from gateways.mavlink.commands.driving_commands import DrivingCommands, GuidingCommands
from gateways.mavlink.commands.vehicle_commands import (
    ArmingCommands,
    OriginService,
    SigningSetup,
    UpkeepCommands,
)
from gateways.mavlink.ftp_server import FileServer, VirtualTree
from gateways.mavlink.liveness import ClockSync, HeartbeatStream, RobotTexts, SilenceTexts
from gateways.mavlink.log_protocol import LogProtocol, Recordings
from gateways.mavlink.mav_service import MavService, Pacing
from gateways.mavlink.mav_vehicle import Face, MavVehicle
from gateways.mavlink.missions.plan_kinds import FenceKind, MissionKind
from gateways.mavlink.missions.plan_protocol import MissionProtocol
from gateways.mavlink.missions.plan_status import CurrentItem, FenceService, ReachedItems
from gateways.mavlink.motion.guided import GuidedDrive, GuidedItems, ReachedGoals, SetpointStream
from gateways.mavlink.motion.manual_control import ManualDriving
from gateways.mavlink.motion.pilot import Pilot
from gateways.mavlink.parameter_protocol import ParameterProtocol, ParameterStore
from gateways.mavlink.signing import SigningGuard
from gateways.mavlink.streams import MessageRequests, StreamScheduler


class ServiceGroup(NamedTuple):
    """Services, and the tables of their commands."""

    services: tuple[MavService, ...]
    tables: tuple[CommandTable, ...]


def parameters_and_files(vehicle: MavVehicle, recordings: Path | None) -> list[MavService]:
    """Return these services; without a folder there are no recordings."""
    pacing = Pacing(vehicle.clients)
    store = ParameterStore(vehicle)
    found = Recordings(recordings, vehicle.port.name, lambda: vehicle.is_armed)
    return [
        ParameterProtocol(vehicle, store, pacing),
        FileServer(vehicle, VirtualTree(store, found), pacing),
        LogProtocol(vehicle, found, pacing),
    ]


def missions_of(vehicle: MavVehicle) -> ServiceGroup:
    """Return the services for missions and fences."""
    mission, fence = MissionKind(vehicle), FenceKind(vehicle)
    current, fences = CurrentItem(vehicle, mission, fence), FenceService(vehicle, fence)
    reached = ReachedItems(vehicle, current)
    services = (MissionProtocol(vehicle, mission, fence), current, reached, fences)
    return ServiceGroup(services, (current.table, fences.table))


def motion_of(vehicle: MavVehicle) -> ServiceGroup:
    """Return the services and the commands that move the robot; they share one pilot."""
    pilot = Pilot(vehicle)
    drive = GuidedDrive(vehicle, pilot)
    services = (
        pilot,
        SetpointStream(vehicle, pilot, drive),
        GuidedItems(vehicle, pilot),
        ReachedGoals(vehicle),
        ManualDriving(vehicle),
    )
    tables = (
        ArmingCommands(vehicle).table,
        DrivingCommands(vehicle, pilot).table,
        GuidingCommands(vehicle, pilot, drive).table,
        UpkeepCommands(vehicle).table,
    )
    return ServiceGroup(services, tables)


def streams_of(vehicle: MavVehicle) -> ServiceGroup:
    """Return the services that send telemetry, and that for control, which has a stream."""
    scheduler = StreamScheduler(vehicle)
    requests, origin = MessageRequests(vehicle, scheduler), OriginService(vehicle)
    control = OperatorCommands(vehicle, scheduler)
    services = (
        HeartbeatStream(vehicle),
        control,
        scheduler,
        requests,
        origin,
        ClockSync(vehicle),
        RobotTexts(vehicle),
        SilenceTexts(vehicle),
    )
    return ServiceGroup(services, (requests.table, origin.table, control.table))


def face_of(
    vehicle: MavVehicle, recordings: Path | None = None, guard: SigningGuard | None = None
) -> Face:
    """Return the face of a vehicle, with all its protocols.

    `recordings` is their folder. Without a `guard` clients cannot set a signing key.
    """
    motion, streams = motion_of(vehicle), streams_of(vehicle)
    missions = missions_of(vehicle)
    tables = (*motion.tables, *streams.tables, *missions.tables)
    services: list[MavService] = [
        *streams.services,
        *motion.services,
        *missions.services,
        CommandService(vehicle, *tables),
        *parameters_and_files(vehicle, recordings),
    ]
    if guard is not None:
        services.append(SigningSetup(vehicle, guard))
    return Face(vehicle, services)
