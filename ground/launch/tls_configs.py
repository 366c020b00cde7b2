"""The processes of `up` behind locked doors: to each its own certificate of a `keys` folder."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

from ground.client.connection import Config
from protocol.bus.network import LOCKED, Network
from runtime.config import load_shared
from runtime.errors import UserError

GROUND: Final = "ground"
PLAIN: Final = "tcp/"


def with_locks(locks: str | None, role: str, words: list[str]) -> list[str]:
    """The arguments of a process that goes by this role, such as `robot r2` or `recorder r2`."""
    return words if locks is None else [*words, "--config", str(file_of(locks, role))]


def file_of(locks: str, role: str) -> Path:
    """The configuration of a process; what records is of the ground."""
    kind, _, robot = role.partition(" ")
    holder = {"robot": f"robot-{robot}", "recorder": GROUND}.get(kind, kind)
    return Path(locks) / f"{holder}.toml"


def ground_file(locks: str | None) -> str | None:
    """For whatever the ground station starts itself."""
    return None if locks is None else str(file_of(locks, GROUND))


def dialling(locks: str | None, network: Network) -> Network:
    """The ground's own way to the others."""
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
    return endpoint if locks is None else endpoint.replace(PLAIN, LOCKED)


def check(locks: str | None, roles: Iterable[str]) -> None:
    """UserError names the first that has no certificate, before anything is started."""
    if locks is None:
        return
    for role in roles:
        path = file_of(locks, role)
        if not path.is_file():
            raise UserError(
                f"--locks {locks}: there is no {path.name} for the {role}: "
                "make a set with `sidestep keys new DIR --robots r1 r2 ...`"
            )
