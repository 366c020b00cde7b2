"""Test ghosts on the map: started by a key or a command, with the outcome in the log."""

import asyncio
import json
from threading import Event

import pytest

from ground.app.commands.local_commands import LocalCommands
from ground.app.screens.drive import DriveScreen
from ground.console.app_commands import AppCommand
from ground.console.parser import read
from protocol.world import GoalPose, Start, World, as_json
from runtime.errors import UserError
from tests.support.tui.fakes import FakeStation
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.underway import driving
from tests.support.until import PATIENCE_S

FLOOR = World(
    name="floor",
    size_m=(10.0, 8.0),
    start=Start(x_m=0.8, y_m=1.0),
    goal=GoalPose(x_m=9.0, y_m=7.0),
)


def simulated() -> FakeStation:
    station = driving(FakeStation())
    assert station.world_now is not None
    station.world_now = station.world_now._replace(text=json.dumps(as_json(FLOOR, None)))
    return station


def drive_of(stage: Stage) -> DriveScreen:
    assert isinstance(stage.app.screen, DriveScreen)
    return stage.app.screen


async def ended(stage: Stage) -> None:
    pause = Event()
    async with asyncio.timeout(PATIENCE_S):
        while drive_of(stage).ghost_runner.busy:
            pause.wait(0.01)
            await stage.redraw()
    await stage.redraw()


def test_chosen_ghost_is_drawn_on_the_map() -> None:
    async def story() -> None:
        async with staged((110, 30), station=simulated()) as stage:
            await stage.press("n")
            await stage.press("enter")  # the first of the list
            assert [ghost.label for ghost in drive_of(stage).map.scene.ghosts] == ["bug"]
            await ended(stage)
            (ghost,) = drive_of(stage).map.scene.ghosts
            assert (ghost.label, ghost.outcome) == ("bug", "reached")
            assert ghost.path_m[0] == pytest.approx((4.15, 2.80), abs=1e-6)
            assert "ghost bug: reached after" in stage.log()

    play(story)


def test_refused_ghost_is_explained_in_the_log() -> None:
    async def story() -> None:
        station = driving(FakeStation())
        station.world_now = None
        async with staged(station=station) as stage:
            await stage.press("n", "enter")
            assert "no ghost: the world is unknown" in stage.log()
            assert drive_of(stage).map.scene.ghosts == []

    play(story)


def test_ghost_command_checks_the_navigator() -> None:
    async def story() -> None:
        async with staged(station=simulated()) as stage:
            words = LocalCommands(stage.app)

            def typed(line: str) -> str:
                command = read(line)
                assert isinstance(command, AppCommand)
                return words.do_command(command)

            assert typed("ghost vgm") == ""
            await ended(stage)
            assert [ghost.label for ghost in drive_of(stage).map.scene.ghosts] == ["vgm"]
            assert typed("ghost none") == ""
            await stage.redraw()
            assert drive_of(stage).map.scene.ghosts == []
            with pytest.raises(UserError):
                typed("ghost vfh")

    play(story)


def test_ghosts_end_with_the_app() -> None:
    async def story() -> None:
        async with staged(station=simulated()) as stage:
            screen = drive_of(stage)
            screen.start_ghost("all")
            assert screen.ghost_runner.busy
        assert not screen.ghost_runner.busy

    play(story)
