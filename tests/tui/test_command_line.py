"""The command line of the app: threads, refusals, completions, and sharing a run."""

from math import pi
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest

from ground.app.appearance import Appearance
from ground.app.commands.runner import CommandRunner, refuse
from ground.app.playback.player import Player
from ground.app.widgets.command_line import CommandLine, candidate_rows
from ground.app.widgets.rows import words_of
from ground.client.connection import Common
from ground.client.goal import destination
from ground.commands.goto import Goto
from ground.commands.stop import ClearEmergencyStop, StopNow
from ground.console.app_commands import AppCommand, SetTheme, ShowHelp
from ground.console.completion import Candidate
from ground.console.history import History
from ground.console.parser import read
from ground.map.scene import MapTarget
from ground.station.robot.command_queue import REPLAYED
from ground.station.robot.robot_stop import StopRecord
from ground.station.world import parse_world
from protocol.bus.network import Network
from protocol.options import DEFAULT_ENDPOINT
from protocol.topics import STATUS
from protocol.wire.enums import Vehicle
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock
from tests.support.app import (
    STOP_ID,
    FakeCommandSink,
    FakeStation,
    Stage,
    SynchronousApp,
    driving,
    recorded,
    staged,
    stopped,
)
from tests.support.each import each
from tests.support.ground.client import ScriptedBus, status
from tests.support.ground.station import WORLD_TEXT

ELSEWHERE = "tcp/10.0.0.7:7447"


def command_runner(
    endpoint: str = DEFAULT_ENDPOINT, config: str | None = None
) -> tuple[CommandRunner, FakeStation]:
    station = driving(FakeStation())
    network = Network(mode="client", connect=tuple(endpoint.split(", ")))
    common = Common(network=network, robot="r1", config=config)
    return CommandRunner(lambda: station, common, History()), station


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
    station.queue.submit = lambda _, command, **__: bool(given.append(command))  # type: ignore
    runner.run_line("clear-estop --all")
    (command,) = given
    assert command.stop_ids == (("r1", (8,)), ("r2", (9, 10)))


@each("typed", [False, True])
def test_a_release_names_the_stop_that_is_shown(typed: bool) -> None:
    """Another stop that is pressed before the release is sent must stay."""
    bus = ScriptedBus(ManualClock(), ())
    bus.say(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=8))
    station = stopped(Vehicle.EMERGENCY_STOP)
    common = Common(network=Network(mode="client", connect=(ELSEWHERE,)), robot="r1")
    station.robot_bus = bus
    runner = CommandRunner(lambda: station, common, History())
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
    station.robot_bus = bus
    runner = CommandRunner(lambda: station, common, History())
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


def test_last_line_dials_all_endpoints_with_the_keys() -> None:
    runner, station = command_runner("tcp/a:1, tcp/b:2", "my keys/ground.toml")
    station.ready_now = False
    runner.run_line("hold")
    dialled = "--connect tcp/a:1 --connect tcp/b:2 --config 'my keys/ground.toml'"
    assert runner.last == f"sidestep hold {dialled}"


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
    assert done == [SetTheme(name="light"), ShowHelp(word="hold")]
    assert "light it is" in log(station)
    assert "not available on this screen" in log(station)


def test_mission_draft_is_made_by_lines(tmp_path: Path) -> None:
    runner, station = command_runner()
    for line in ("wp add 1 2", "wp add 3 4 90", "wp list", f"wp save {tmp_path / 'm.toml'}"):
        runner.run_line(line)
    assert runner.draft_items == (
        MapTarget(1.0, 2.0, None, 0.05, 1),
        MapTarget(3.0, 4.0, pi / 2.0, 0.05, 2),
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
    bus = station.robot_bus = ScriptedBus(ManualClock(), ())
    runner.run_line(line)
    assert "outside the world box" in log(station)
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


def test_teleop_is_refused_in_a_replay() -> None:
    runner, station = command_runner()
    station.live_now = False
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


def line_of(stage: Stage) -> CommandLine:
    return stage.app.screen.query_one(CommandLine)


def shown(stage: Stage) -> str:
    panel = stage.app.screen.query_one("#candidates")
    return stage.words("candidates") if panel.display else ""


async def test_completions_are_listed_with_their_meaning() -> None:
    async with staged() as stage:
        await stage.press("colon")
        await stage.type("mode ")
        await stage.redraw()
        assert "hold          stopped; keeps its goal" in shown(stage)
        await stage.press("g")
        assert shown(stage).split()[0] == "guided"
        await stage.press("escape")
        assert shown(stage) == ""


async def test_tab_and_arrows_choose_a_completion() -> None:
    async with staged() as stage:
        await stage.press("colon")
        await stage.type("ho")
        await stage.press("ctrl+u")
        await stage.type("mode ")
        await stage.press("tab", "tab", "down")
        assert line_of(stage).value == "mode auto"
        await stage.press("up", "shift+tab")
        assert line_of(stage).value == "mode manual"
        await stage.press("escape")
        assert line_of(stage).value == "mode "
        await stage.press("tab", "enter")
        assert stage.commands.given == ["mode manual"]


async def test_down_chooses_from_the_list_when_there_is_no_newer_line() -> None:
    async with staged() as stage:
        await stage.press("colon")
        await stage.type("screen p")
        stage.commands.recall = lambda text, step: text  # type: ignore[method-assign]
        await stage.press("down")
        assert line_of(stage).value == "screen plots"


async def test_arguments_and_units_are_shown_behind_the_cursor() -> None:
    async with staged() as stage:
        await stage.press("g")
        await stage.until(lambda: "[X] [Y] [DEG]  metres, degrees" in drawn(stage))
        await stage.press("right", "end")
        assert line_of(stage).value == "goal "
        await stage.type("1 2")
        await stage.until(lambda: "[DEG]  degrees" in drawn(stage))
        await stage.press("enter")
        assert stage.commands.given == ["goal 1 2"]


def drawn(stage: Stage) -> str:
    return line_of(stage).render_line(0).text


async def test_value_of_a_parameter_has_its_range_as_a_hint() -> None:
    async with staged() as stage:
        await stage.press("3", "e")
        await stage.until(lambda: "0 to 5 m, now 0.4" in drawn(stage))
        assert shown(stage) == ""
        await stage.press("h")
        assert shown(stage) == ""


async def test_history_is_searched_and_a_line_is_edited() -> None:
    async with staged() as stage:
        stage.commands.given = ["goal 1 2", "hold", "goal 3 4 90"]
        await stage.press("colon", "ctrl+r")
        assert stage.words("prompt") == "search the history:"
        await stage.type("go")
        await stage.redraw()
        assert [line.strip() for line in shown(stage).splitlines()] == [
            "goal 3 4 90",
            "goal 1 2",
        ]
        await stage.press("tab", "tab", "enter")
        assert line_of(stage).value == "goal 1 2"
        assert stage.commands.given[3:] == []
        await stage.press("enter")
        assert stage.commands.given[3:] == ["goal 1 2"]


def test_long_list_shows_the_chosen_row_and_the_count() -> None:
    many = [Candidate(f"w{number}", f"w{number}", "text") for number in range(40)]
    rows = list(map(words_of, candidate_rows(many, 30, 60, 20)))
    assert len(rows) == 8
    assert any(row.startswith(" w30 ") for row in rows)
    assert "40 in all" in rows[-1]
    assert candidate_rows(many, None, 60, 0) == []
    assert all(len(words_of(row)) <= 10 for row in candidate_rows(many, None, 10, 3))


async def test_without_a_recording_there_is_nothing_to_share() -> None:
    async with staged() as stage:
        await stage.press("Z")
        assert "nothing is recorded here" in stage.log()


async def test_a_played_recording_is_shared(tmp_path: Path) -> None:
    player = Player(recorded(tmp_path), ManualClock())
    app = SynchronousApp(None, FakeCommandSink(), appearance=Appearance(hz=0.0), player=player)
    async with app.run_test(size=(100, 28)) as pilot:
        await pilot.press("Z")
        await pilot.pause()
        archive = player.path.with_suffix(".zip")
        assert f"shared: {archive}" in "\n".join(line.text for line in app.station.log)
        with ZipFile(archive) as held:
            assert player.path.name in held.namelist()
