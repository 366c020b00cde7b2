"""Command lines of the app: done off the screen's thread, refused with reasons, copied as shell."""

from math import pi
from pathlib import Path

import pytest

from ground.app.commands.runner import CommandRunner, refuse
from ground.client.connection import Common
from ground.client.goal import destination
from ground.client.operations import Goto, StopNow
from ground.console import AppCommand, History, read
from ground.console.app_commands import SetTheme
from ground.map import Target
from protocol.bus.network import Network
from protocol.options import DEFAULT_ENDPOINT
from runtime.clock import ManualClock
from tests.support.tui.fakes import FakeStation
from tests.support.tui.underway import driving

ELSEWHERE = "tcp/10.0.0.7:7447"


def commands(endpoint: str = DEFAULT_ENDPOINT) -> tuple[CommandRunner, FakeStation]:
    station = driving(FakeStation())
    common = Common(network=Network(mode="client", connect=(endpoint,)), robot="r1")
    return CommandRunner(lambda: station, None, common, ManualClock(), History()), station


def log(station: FakeStation) -> str:
    return "\n".join(line.text for line in station.log)


@pytest.mark.parametrize(
    ("line", "moving"),
    [
        ("goal 1 2", True),
        ("resume", True),
        ("arm", True),
        ("set d_obs_m 0.4", True),
        ("mission start", True),
        ("hold", False),
        ("abort", False),
        ("disarm", False),
        ("get d_*", False),
        ("doctor", False),
        ("mission list", False),
    ],
)
def test_what_can_move_the_robot_needs_it_to_be_ours(line: str, moving: bool) -> None:
    operation = read(line)
    assert not isinstance(operation, AppCommand)
    assert operation.moves is moving


def test_the_stop_goes_its_own_way() -> None:
    taker, station = commands()
    taker.run_line("estop")
    taker.run_line("stop")
    assert (station.stops, station.asked) == (2, [])


def test_a_word_that_is_none_is_said_to_be_wrong_with_a_hint() -> None:
    taker, station = commands()
    taker.run_line("holdd")
    assert "did you mean 'hold'" in log(station)
    assert station.asked == []


def test_an_empty_line_is_nothing() -> None:
    taker, station = commands()
    taker.run_line("")
    assert len(station.log) == 0


def test_the_last_line_is_a_command_for_a_shell() -> None:
    taker, station = commands(ELSEWHERE)
    station.ready_now = False
    station.robot_now = "r2"
    taker.run_line("goal 9 7 90")
    assert taker.last == f"sidestep goto 9 7 90 --id r2 --connect {ELSEWHERE}"
    assert "nothing is heard of r1" in log(station)


def test_words_of_the_app_are_done_at_once_and_help_is_there() -> None:
    taker, station = commands()
    done: list[AppCommand] = []

    def local(command: AppCommand) -> str:
        if not isinstance(command, SetTheme):
            return refuse(command)
        done.append(command)
        return "light it is"

    taker.local = local
    taker.run_line("theme light")
    taker.run_line("help hold")
    taker.run_line("zoom in")
    assert done == [SetTheme("light")]
    assert "light it is" in log(station)
    assert "hold" in log(station)
    assert "is not there on this screen" in log(station)


def test_a_draft_of_a_mission_is_made_line_by_line(tmp_path: Path) -> None:
    taker, station = commands()
    for line in ("wp add 1 2", "wp add 3 4 90", "wp list", f"wp save {tmp_path / 'm.toml'}"):
        taker.run_line(line)
    assert taker.draft_items == (Target(1.0, 2.0, None, 0.05), Target(3.0, 4.0, pi / 2.0, 0.05))
    assert "(3, 4) at 90 deg" in log(station)
    assert (tmp_path / "m.toml").exists()


def test_lines_are_remembered_and_completed() -> None:
    taker, _ = commands()
    for line in ("help goto", "theme"):
        taker.run_line(line)
    assert taker.recall("", -1) == "theme"
    assert taker.recall("theme", -1) == "help goto"
    assert taker.recall("help goto", 1) == "theme"
    assert "set guard_stop_m" in taker.complete("set gu")
    assert taker.is_local("theme dark")
    assert not taker.is_local("hold")


def test_over_a_recording_nothing_can_be_taken_by_hand() -> None:
    taker, station = commands()
    taker.steer(1.0, 1.0)
    assert not taker.begin_teleop()
    assert "this is a replay" in log(station)


def test_what_a_key_means_is_remembered_as_a_line() -> None:
    taker, station = commands(ELSEWHERE)
    taker.perform(StopNow())
    assert station.stops == 1
    station.ready_now = False
    taker.perform(Goto(goal=destination([9.0, 7.0, 90.0])))
    assert station.asked == ["goal 9 7 90"]
    assert taker.last == f"sidestep goto 9 7 90 --connect {ELSEWHERE}"
    assert taker.recall("", -1) == "goal 9 7 90"
