"""Strangers without a certificate keep no operator out of a locked bus."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from checks.flood.attackers import Strangers
from checks.harness.processes import (
    free_port,
    made_keys,
    robot_process,
    sidestep,
    tls_of,
)
from plant.world.file import load
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import Role
from tests.support.until import PATIENCE_S, until

RATE_HZ = 100.0
CALLS = 300
"""Without a door, Zenoh needs 30 s for these; meanwhile more come."""

SAME, OTHER = "127.0.0.1", "127.0.0.2"


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_keys(tmp_path_factory.mktemp("keys") / "keys")


@contextmanager
def hub(kind: str, keys: Path) -> Iterator[str]:
    """Run a locked router or robot; return its endpoint."""
    if kind == "robot":
        with robot_process(load("corridor"), keys=keys) as robot:
            yield robot.network.connect[0]
        return
    endpoint = f"tls/127.0.0.1:{free_port()}"
    config = ("--config", str(keys / "router.toml"))
    with sidestep("run", "router", "--listen", endpoint, *config, ready="router at"):
        yield endpoint


@pytest.mark.parametrize(
    ("kind", "way", "source"),
    [
        ("router", "garbage", SAME),
        ("router", "http", SAME),
        ("router", "hello", OTHER),
        ("robot", "garbage", SAME),
    ],
)
def test_fresh_operator_links_beside_strangers(
    kind: str, way: str, source: str, keys: Path
) -> None:
    """Review 3, 1: 25 connections a second kept every operator out, for ever."""
    with hub(kind, keys) as endpoint, Strangers(endpoint, way, RATE_HZ, source) as strangers:
        until(lambda: strangers.called >= CALLS, what="the attack")
        network = Network(
            mode="client",
            connect=(endpoint,),
            tls=tls_of(keys, "ground"),
            connect_timeout_s=PATIENCE_S,
        )
        with open_bus(network, Role.GROUND, "r1") as bus:
            assert bus.hub().linked
