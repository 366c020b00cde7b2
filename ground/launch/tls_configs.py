"""Give each process of `up` its own certificate from a `keys` folder."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

from ground.client.connection import Config
from protocol.bus.network import LOCKED, Network
from runtime.config import load_shared
from runtime.errors import UserError

GROUND: Final = "ground"
GATEWAY: Final = "gateway"
PLAIN: Final = "tcp/"


def with_locks(locks: str | None, role: str, words: list[str]) -> list[str]:
    """Return the arguments of a process with this role, such as `robot r2` or `recorder r2`."""
    return words if locks is None else [*words, "--config", str(file_of(locks, role))]


def file_of(locks: str, role: str) -> Path:
    """Return the configuration file of a role.

    A recorder uses the ground station's, and a ROS 2 gateway that of gateways.
    """
    kind, _, robot = role.partition(" ")
    holder = {"robot": f"robot-{robot}", "recorder": GROUND, "ros2": GATEWAY}.get(kind, kind)
    return Path(locks) / f"{holder}.toml"


def ground_file(locks: str | None) -> str | None:
    """Return the configuration file for processes that the ground station starts."""
    return None if locks is None else str(file_of(locks, GROUND))


def dialling(locks: str | None, network: Network) -> Network:
    """Return the network settings with which the ground station dials the others."""
    if locks is None:
        return network
    found = load_shared(file_of(locks, GROUND), Config).network or Network()
    connect = tuple(locked(locks, endpoint) for endpoint in network.connect)
    return replace(
        network,
        connect=connect,
        tls=found.tls,
        robots=found.robots,
        operators=found.operators,
        revoked=found.revoked,
    )


def locked(locks: str | None, endpoint: str) -> str:
    """Return the endpoint, with TLS where certificates are used."""
    return endpoint if locks is None else endpoint.replace(PLAIN, LOCKED)


def check(locks: str | None, roles: Iterable[str]) -> None:
    """Raise UserError for the first role without a certificate, before anything is started."""
    if locks is None:
        return
    for role in roles:
        path = file_of(locks, role)
        if not path.is_file():
            raise UserError(
                f"--locks {locks}: there is no {path.name} for the {role}: "
                "make a set with `sidestep keys new DIR --robots r1 r2 ...`"
            )
