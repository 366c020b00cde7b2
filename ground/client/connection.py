"""Options that verbs have in common, and the numbers they take: in range, or refused at once."""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from protocol.bus.network import Network
from protocol.options import CONFIG_HELP, DEFAULT_ENDPOINT, above_zero, dialled, usual_endpoint
from protocol.topics import robot_name
from runtime.config import load_shared
from runtime.errors import UserError

DIAL_S: Final = 1.5
LONGEST_S: Final = 7 * 24 * 3600.0
positive: Final = above_zero()
seconds: Final = above_zero(LONGEST_S)


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


def add_common(parser: argparse.ArgumentParser, *, listens: bool = False) -> None:
    """`--connect` (or `--listen`), `--id`, `--config` and `--json`.

    `attended`: somebody else beats the operator's heart, holds the lease and watches the goal.
    """
    parser.set_defaults(attended=False)
    if listens:
        parser.add_argument("--listen", metavar="ENDPOINT", help=f"({DEFAULT_ENDPOINT})")
    else:
        parser.add_argument("--connect", metavar="ENDPOINT", help=f"({DEFAULT_ENDPOINT})")
        parser.add_argument("--id", metavar="NAME", help="name of the robot (r1)")
    parser.add_argument("--config", metavar="FILE", help=CONFIG_HELP)
    add_json(parser)


def add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")


def common_of(options: argparse.Namespace) -> Common:
    """Defaults, then the file, then the command line; UserError names what is wrong."""
    return common(options.connect, options.id, options.config)


def common(endpoint: str | None, robot: str | None, config: str | Path | None) -> Common:
    """Defaults, then the file, then what was given; UserError names what is wrong."""
    found = Config() if config is None else load_shared(Path(config), Config)
    network = found.network or Network()
    connect = dialled(network) if endpoint is None else (endpoint,)
    network = replace(network, mode="client", connect=connect, listen=(), connect_timeout_s=DIAL_S)
    return Common(network=network, robot=robot_name(robot or found.robot))


def listening_of(options: argparse.Namespace) -> Network:
    """The network of a process that routes for others."""
    config = Config() if options.config is None else load_shared(Path(options.config), Config)
    network = config.network or Network()
    listen = network.listen or (usual_endpoint(network),)
    if options.listen is not None:
        listen = (options.listen,)
    return replace(network, mode="router", listen=listen)


def within(value: float, low: float, high: float, what: str, unit: str) -> float:
    """The value; UserError when it is out of range."""
    if not low <= value <= high:
        raise UserError(f"{what} {value:g} {unit} is out of range: {low:g} to {high:g} {unit}")
    return value
