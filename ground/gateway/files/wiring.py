"""The protocols of parameters and files, with one parameter list and one rate limit."""

from pathlib import Path

from ground.gateway.files.logs import LogProtocol
from ground.gateway.files.pacing import Pacing
from ground.gateway.files.recordings import Recordings
from ground.gateway.files.server import FileServer
from ground.gateway.files.tree import VirtualTree
from ground.gateway.parameters.protocol import ParameterProtocol
from ground.gateway.parameters.store import ParameterStore
from ground.gateway.traffic import MavService
from ground.gateway.vehicle import Vehicle


def parameters_and_files(vehicle: Vehicle, recordings: Path | None) -> list[MavService]:
    """Return the protocols of one vehicle; without a folder there are no recordings."""
    pacing = Pacing(vehicle.clients)
    store = ParameterStore(vehicle)
    found = Recordings(recordings, vehicle.port.name, lambda: vehicle.is_armed)
    return [
        ParameterProtocol(vehicle, store, pacing),
        FileServer(vehicle, VirtualTree(store, found), pacing),
        LogProtocol(vehicle, found, pacing),
    ]
