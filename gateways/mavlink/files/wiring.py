"""The protocols of parameters and files, with one parameter list and one rate limit."""

from pathlib import Path

from gateways.mavlink.files.logs import LogProtocol
from gateways.mavlink.files.pacing import Pacing
from gateways.mavlink.files.recordings import Recordings
from gateways.mavlink.files.server import FileServer
from gateways.mavlink.files.tree import VirtualTree
from gateways.mavlink.parameters.protocol import ParameterProtocol
from gateways.mavlink.parameters.store import ParameterStore
from gateways.mavlink.traffic import MavService
from gateways.mavlink.vehicle import Vehicle


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
