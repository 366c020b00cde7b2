"""Test the command runner: threads, refusals, and lines for a shell."""

from math import pi
from pathlib import Path
from typing import Any

import pytest

from ground.app.commands.runner import CommandRunner, refuse
from ground.client.connection import Common
from ground.client.goal import destination
from ground.client.operations.commands import ClearEmergencyStop, StopNow
from ground.client.operations.goals import Goto
from ground.console.app_commands import AppCommand, SetTheme, ShowHelp
from ground.console.history import History
from ground.console.parser import read
from ground.map.scene import MapTarget
from ground.station.robot.robot_stop import StopRecord
from ground.station.station import REPLAYED
from ground.station.world import parse_world
from protocol.bus.network import Network
from protocol.options import DEFAULT_ENDPOINT
from protocol.topics import STATUS
from protocol.wire.enums import Vehicle
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock
from runtime.errors import UserError
from tests.support.each import each
from tests.support.ground.client import ScriptedBus, status
from tests.support.ground.station.play import WORLD_TEXT
from tests.support.tui.fakes import FakeStation
from tests.support.tui.stopped import STOP_ID, stopped
from tests.support.tui.underway import driving

ELSEWHERE = "tcp/10.0.0.7:7447"


def command_runner(endpoint: str = DEFAULT_ENDPOINT) -> tuple[CommandRunner, FakeStation]:
    station = driving(FakeStation())
    common = Common(network=Network(mode="client", connect=(endpoint,)), robot="r1")
    return CommandRunner(lambda: station, None, common, ManualClock(), History()), station


def log(station: FakeStation) -> str:
    return "\n".join(line.text for line in station.log)


@each(
    ("line", "moving"),
    [
        ("goal 1 2", True),
        ("resume", True),
        ("arm", True),
        ("set d_obs_m 0.4", True),
        ("mission start", True),
        ("mode guided", True),
        ("mode hold", False),
        ("hold", False),
        ("abort", False),
        ("disarm", False),
        ("get d_*", False),
        ("doctor", False),
        ("mission list", False),
    ],
)
def test_operations_that_move_the_robot_are_marked(line: str, moving: bool) -> None:
    operation = read(line)
    assert not isinstance(operation, AppCommand)
    assert operation.moves is moving


def test_stop_bypasses_the_request_queue() -> None:
    runner, station = command_runner()
    runner.run_line("estop")
    runner.run_line("stop")
    assert (station.stops, station.asked) == (2, [])
    for line in ("estop all", "estop --all", "stop all"):
        runner.run_line(line)
    assert (station.stops, station.stops_of_all, station.asked) == (2, 3, [])


def test_a_stop_is_sent_before_its_line_is_saved(monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk of the history may be full or slow."""
    runner, station = command_runner()
    sent: list[tuple[int, int]] = []
    note = lambda _self, _line: sent.append((station.stops, station.stops_of_all))  # noqa: E731
    monkeypatch.setattr(History, "add", note)
    runner.run_line("estop")
    runner.run_line("estop --all")
    assert sent == [(1, 0), (1, 1)]


def test_a_release_of_all_names_the_stops_that_are_shown() -> None:
    runner, station = command_runner()
    given: list[Any] = []
    station.all_stops_known = lambda: (("r1", (8,)), ("r2", (9, 10)))  # type: ignore[method-assign]
    station.submit = lambda _, job, **__: bool(given.append(job))  # type: ignore
    runner.run_line("clear-estop --all")
    (job,) = given
    assert job.args[0].stop_ids == (("r1", (8,)), ("r2", (9, 10)))


@each("typed", [False, True])
def test_a_release_names_the_stop_that_is_shown(typed: bool) -> None:
    """Another stop that is pressed before the release is sent must stay."""
    bus = ScriptedBus(ManualClock(), ())
    bus.set_newest(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=8))
    station = stopped(Vehicle.EMERGENCY_STOP)
    common = Common(network=Network(mode="client", connect=(ELSEWHERE,)), robot="r1")
    runner = CommandRunner(lambda: station, bus, common, ManualClock(), History())
    if typed:
        runner.run_line("clear-estop")
    else:
        runner.perform(ClearEmergencyStop())
    assert [request.stop_id for request in bus.requests] == [STOP_ID]


def test_a_release_may_name_the_last_stop_of_this_station() -> None:
    """The robot may acknowledge it by datagram before its status arrives."""
    bus = ScriptedBus(ManualClock(), (Reason.NEWER_STOP,))
    station = stopped(Vehicle.EMERGENCY_STOP)
    station.last_stop_now = StopRecord(21, station.clock.now_ns(), None)
    common = Common(network=Network(mode="client", connect=(ELSEWHERE,)), robot="r1")
    runner = CommandRunner(lambda: station, bus, common, ManualClock(), History())
    runner.run_line("clear-estop")
    assert [request.stop_id for request in bus.requests] == [STOP_ID, 21]


def test_unknown_word_gets_a_hint() -> None:
    runner, station = command_runner()
    runner.run_line("holdd")
    assert "did you mean 'hold'" in log(station)
    assert station.asked == []


def test_empty_line_does_nothing() -> None:
    runner, station = command_runner()
    runner.run_line("")
    assert len(station.log) == 0


def test_last_line_is_a_command_for_a_shell() -> None:
    runner, station = command_runner(ELSEWHERE)
    station.ready_now = False
    station.robot_now = "r2"
    runner.run_line("goal 9 7 90")
    assert runner.last == f"sidestep goto 9 7 90 --id r2 --connect {ELSEWHERE}"
    assert "no message from the robot" in log(station)


def test_commands_for_the_screen_and_help_run_at_once() -> None:
    runner, station = command_runner()
    done: list[AppCommand] = []

    def local(command: AppCommand) -> str:
        if not isinstance(command, SetTheme | ShowHelp):
            return refuse(command)
        done.append(command)
        return "light it is"

    runner.local = local
    runner.run_line("theme light")
    runner.run_line("help hold")
    runner.run_line("zoom in")
    assert done == [SetTheme("light"), ShowHelp("hold")]
    assert "light it is" in log(station)
    assert "not available on this screen" in log(station)


def test_mission_draft_is_made_by_lines(tmp_path: Path) -> None:
    runner, station = command_runner()
    for line in ("wp add 1 2", "wp add 3 4 90", "wp list", f"wp save {tmp_path / 'm.toml'}"):
        runner.run_line(line)
    assert runner.draft_items == (
        MapTarget(1.0, 2.0, None, 0.05),
        MapTarget(3.0, 4.0, pi / 2.0, 0.05),
    )
    assert "(3, 4) at 90 deg" in log(station)
    assert (tmp_path / "m.toml").exists()


def test_waypoint_outside_the_world_is_not_drafted() -> None:
    runner, station = command_runner()
    station.world_now = parse_world(WORLD_TEXT)
    runner.run_line("wp add 100 1")
    assert "waypoint (100, 1) lies outside the world box (6 x 4 m)" in log(station)
    runner.run_line("wp add 1 1")
    assert len(runner.draft_items) == 1


@each("line", ["goal 100 100", "goal 1 -0.5 90 --no-wait", "pose set 7 1 90"])
def test_goal_outside_the_world_is_refused_before_it_is_sent(line: str) -> None:
    runner, station = command_runner()
    station.world_now = parse_world(WORLD_TEXT)
    operation = read(line)
    assert not isinstance(operation, AppCommand)
    bus = ScriptedBus(ManualClock(), ())
    runner._bus = bus
    with pytest.raises(UserError, match="outside the world box"):
        runner._done(operation)
    assert bus.requests == []


def test_lines_are_recalled_and_completed() -> None:
    runner, _ = command_runner()
    for line in ("help goto", "theme"):
        runner.run_line(line)
    assert runner.recall("", -1) == "theme"
    assert runner.recall("theme", -1) == "help goto"
    assert runner.recall("help goto", 1) == "theme"
    found = runner.assist("set gu").candidates
    assert [one.line for one in found] == ["set guard_stop_m"]
    assert runner.is_local("theme dark")
    assert not runner.is_local("hold")


def test_teleop_is_refused_in_a_replay() -> None:
    runner, station = command_runner()
    runner.steer(1.0, 1.0)
    assert not runner.begin_teleop()
    assert REPLAYED in log(station)


def test_command_of_a_key_is_recalled_as_a_line() -> None:
    runner, station = command_runner(ELSEWHERE)
    runner.perform(StopNow())
    assert station.stops == 1
    station.ready_now = False
    runner.perform(Goto(goal=destination([9.0, 7.0, 90.0])))
    assert station.asked == ["goal 9 7 90"]
    assert runner.last == f"sidestep goto 9 7 90 --connect {ELSEWHERE}"
    assert runner.recall("", -1) == "goal 9 7 90"
