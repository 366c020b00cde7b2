"""A typed `lease` command is executed by the station, which sends the heartbeats."""

from pathlib import Path
from typing import cast

import pytest

from ground.app.commands.runner import CommandRunner
from ground.client.connection import Common
from ground.console.history import History
from protocol.bus.bus import Bus
from protocol.bus.network import Network
from protocol.wire.enums import Command, Mode, Severity
from protocol.wire.messages import LeaseRequest
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.ground.station.play import Play


def commands_of(play: Play, folder: Path) -> CommandRunner:
    """Return what runs the commands of an app; they reach the played robot."""
    network = Network(mode="client", connect=("tcp/127.0.0.1:7447",))
    common = Common(network=network, robot="r1")
    history, bus = History(folder / "history"), cast(Bus, play.bus)
    return CommandRunner(lambda: play.station, bus, common, play.clock, history)


@pytest.fixture
def commanding(tmp_path: Path) -> tuple[Play, CommandRunner]:
    play = Play().forward(1.0)
    return play, commands_of(play, tmp_path)


def test_typed_lease_uses_the_station(commanding: tuple[Play, CommandRunner]) -> None:
    play, commands = commanding
    commands.run_line("lease take")
    play.forward(1.0)
    assert play.station.lease.ours
    assert play.beats > 1
    commands.run_line("lease release")
    play.forward(1.0)
    assert not play.station.lease.held


def test_typed_seize_takes_a_foreign_lease(commanding: tuple[Play, CommandRunner]) -> None:
    play, commands = commanding
    play.robot.lease.holder, play.robot.lease.name = "theirs", "ben"
    play.forward(1.0)
    commands.run_line("lease take")
    play.forward(1.0)
    assert play.station.lease.others
    commands.run_line("lease seize")
    play.forward(1.0)
    assert play.station.lease.ours


@each("line", ["hold", "abort", "disarm", "mode hold"])
def test_what_stops_is_sent_while_another_person_has_the_lease(line: str, tmp_path: Path) -> None:
    play = Play()
    play.robot.lease.holder, play.robot.lease.name = "theirs", "ben"
    play.forward(1.0)
    loss = play.station.loss()
    assert loss is not None
    assert loss.response == "hold, abort, disarm and E-STOP work. Take over: `lease seize`"
    commands_of(play, tmp_path).run_line(line)
    play.forward(0.2)
    assert len(play.commands) == 1
    assert not [one for _, _, one in play.bus.asked if isinstance(one, LeaseRequest)]
    assert play.texts(f"{line}: ok")


@pytest.fixture
def driving(commanding: tuple[Play, CommandRunner]) -> tuple[Play, CommandRunner]:
    """Return an app that drives r1 by keys."""
    play, commands = commanding
    assert commands.begin_teleop()
    play.forward(0.5)
    (manual,) = play.commands
    assert (manual.command, manual.param2) == (Command.DO_SET_MODE, Mode.MANUAL)
    return play, commands


def test_end_of_teleop_ends_its_own_drive_only(driving: tuple[Play, CommandRunner]) -> None:
    play, commands = driving
    commands.steer(0.2, 0.0)
    commands.end_teleop()
    play.forward(0.2)
    manual, hold = play.commands
    assert (hold.command, hold.param2) == (Command.DO_SET_MODE, Mode.HOLD)
    assert hold.ends_id == manual.request_id
    assert play.texts("mode hold: ok")
    commands.end_teleop()
    play.forward(0.2)
    assert len(play.commands) == 2


def test_end_of_teleop_that_another_drive_ended_is_no_fault(
    driving: tuple[Play, CommandRunner],
) -> None:
    play, commands = driving
    play.refuses = Reason.ALREADY_OVER
    play.robot.lease.holder, play.robot.lease.name = "theirs", "ben"
    play.forward(1.0)
    commands.end_teleop()
    play.forward(0.2)
    assert play.commands[-1].ends_id == play.commands[0].request_id
    (line,) = [line for line in play.station.log if "already over" in line.text]
    assert line.severity == Severity.INFO


def test_end_of_teleop_that_was_never_sent_ends_nothing(
    commanding: tuple[Play, CommandRunner],
) -> None:
    play, commands = commanding
    assert commands.begin_teleop()
    play.station.estop()
    commands.end_teleop()
    play.forward(1.0)
    assert [one.command for one in play.commands] == [Command.DO_FLIGHTTERMINATION]
