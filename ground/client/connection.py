"""The robot and the endpoint to connect to, from a file and the command line; checked numbers."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from protocol.bus.network import Network
from protocol.options import dialled
from protocol.topics import robot_name
from runtime.config import load_shared
from runtime.errors import UserError

CONNECT_TIMEOUT_S: Final = 1.5


@dataclass(frozen=True, kw_only=True)
class Config:
    """The keys of a `--config` file: the robot, and the network to connect to or listen on."""

    robot: str = "r1"
    network: Network | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Common:
    """The network to connect to and the robot to command."""

    network: Network
    robot: str

    @property
    def endpoint(self) -> str:
        """The endpoints to connect to, separated by commas."""
        return ", ".join(self.network.connect)


def common(endpoint: str | None, robot: str | None, config: str | Path | None) -> Common:
    """Merge defaults, the configuration file and explicit values, in this order.

    Raises UserError or ConfigError for a value that is wrong.
    """
    found = Config() if config is None else load_shared(Path(config), Config)
    network = found.network or Network()
    connect = dialled(network) if endpoint is None else (endpoint,)
    network = replace(
        network, mode="client", connect=connect, listen=(), connect_timeout_s=CONNECT_TIMEOUT_S
    )
    return Common(network=network, robot=robot_name(robot or found.robot))


def within(value: float, low: float, high: float, what: str, unit: str) -> float:
    """Return the value; raise UserError if it is outside `low` to `high` (in `unit`)."""
    if not low <= value <= high:
        raise UserError(f"{what} {value:g} {unit} is out of range: {low:g} to {high:g} {unit}")
    return value
