"""Where to dial and which robot to talk to, and numbers in range or refused at once."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from protocol.bus.network import Network
from protocol.options import dialled
from protocol.topics import robot_name
from runtime.config import load_shared
from runtime.errors import UserError

DIAL_S: Final = 1.5


@dataclass(frozen=True, kw_only=True)
class Config:
    """The file of `--config`: which robot, and where to dial or listen."""

    robot: str = "r1"
    network: Network | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Common:
    """Where to dial and whom to talk to, from file and command line."""

    network: Network
    robot: str

    @property
    def endpoint(self) -> str:
        return ", ".join(self.network.connect)


def common(endpoint: str | None, robot: str | None, config: str | Path | None) -> Common:
    """Defaults, then the file, then what was given; UserError names what is wrong."""
    found = Config() if config is None else load_shared(Path(config), Config)
    network = found.network or Network()
    connect = dialled(network) if endpoint is None else (endpoint,)
    network = replace(network, mode="client", connect=connect, listen=(), connect_timeout_s=DIAL_S)
    return Common(network=network, robot=robot_name(robot or found.robot))


def within(value: float, low: float, high: float, what: str, unit: str) -> float:
    """The value; UserError when it is out of range."""
    if not low <= value <= high:
        raise UserError(f"{what} {value:g} {unit} is out of range: {low:g} to {high:g} {unit}")
    return value
