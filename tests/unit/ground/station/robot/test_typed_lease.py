"""A typed `lease` command is executed by the station, which sends the heartbeats."""

from pathlib import Path

import pytest

from ground.app.commands.runner import CommandRunner
from ground.client.connection import Common
from ground.console.history import History
from protocol.bus.network import Network
from tests.support.ground.station.play import Play


@pytest.fixture
def typing(tmp_path: Path) -> tuple[Play, CommandRunner]:
    play = Play().forward(1.0)
    network = Network(mode="client", connect=("tcp/127.0.0.1:7447",))
    history = History(tmp_path / "history")
    common = Common(network=network, robot="r1")
    return play, CommandRunner(lambda: play.station, None, common, play.clock, history)


def test_typed_lease_uses_the_station(typing: tuple[Play, CommandRunner]) -> None:
    play, commands = typing
    commands.run_line("lease take")
    play.forward(1.0)
    assert play.station.lease.ours
    assert play.beats > 1
    commands.run_line("lease release")
    play.forward(1.0)
    assert not play.station.lease.held


def test_typed_seize_takes_a_foreign_lease(typing: tuple[Play, CommandRunner]) -> None:
    play, commands = typing
    play.robot.lease.holder, play.robot.lease.name = "theirs", "ben"
    play.forward(1.0)
    commands.run_line("lease take")
    play.forward(1.0)
    assert play.station.lease.others
    commands.run_line("lease seize")
    play.forward(1.0)
    assert play.station.lease.ours
