"""The robot is stopped from everywhere, and what is driven by hand stops by itself."""

import pytest
from textual import events

from ground.app.screens import SCREENS
from ground.app.screens.drive import DriveScreen
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.underway import driving

SCREEN_KEYS = {name: str(number) for name, number in SCREENS.items()}


def drive_of(stage: Stage) -> DriveScreen:
    assert isinstance(stage.app.screen, DriveScreen)
    return stage.app.screen


@pytest.mark.parametrize("name", SCREENS)
def test_every_screen_has_its_number_and_stops_the_robot(name: str) -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press(SCREEN_KEYS[name])
            assert type(stage.app.screen).__name__ == f"{name.capitalize()}Screen"
            await stage.press("f12")
            await stage.press("space")
            stage.app.post_message(events.Key("ctrl+@", "\x00"))
            await stage.redraw()
            assert stage.station.stops == 3

    play(story)


@pytest.mark.parametrize(
    ("name", "opening"),
    [*((name, "colon") for name in SCREENS), *(("drive", key) for key in ("?", "m", "ctrl+p"))],
)
def test_the_robot_is_stopped_from_whatever_is_open(name: str, opening: str) -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press(SCREEN_KEYS[name])
            await stage.press(opening)
            await stage.press("f12")
            stage.app.post_message(events.Key("ctrl+@", "\x00"))
            await stage.redraw()
            assert stage.station.stops == 2

    play(story)


@pytest.mark.parametrize("opening", ["?", "m"])
def test_space_stops_the_robot_from_where_nothing_is_typed(opening: str) -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press(opening, "space")
            assert stage.station.stops == 1

    play(story)


def test_the_stop_is_released_by_two_presses_only() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("D")
            assert stage.commands.given == []
            stage.station.clock.advance(3_000_000_000)
            await stage.press("D")
            assert stage.commands.given == []
            await stage.press("D")
            assert stage.commands.given == ["clear-estop"]

    play(story)


def test_teleop_steers_while_keys_repeat_and_ends_with_any_other() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("t", "up")
            drive_of(stage).poll()
            assert stage.commands.steered[-1] == (0.25, 0.0)
            await stage.press("A")
            drive_of(stage).poll()
            assert stage.commands.steered[-1] == (0.08, 0.5)
            stage.station.clock.advance(700_000_000)
            drive_of(stage).poll()
            assert stage.commands.steered[-1] == (0.0, 0.0)
            assert stage.commands.teleop
            await stage.press("q")
            assert not stage.commands.teleop

    play(story)


def test_teleop_ends_when_the_robot_is_in_another_mode() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("t")
            stage.station.clock.advance(2_000_000_000)
            driving(stage.station)
            drive_of(stage).poll()
            assert not stage.commands.teleop

    play(story)


def test_space_stops_the_robot_while_it_is_driven_by_hand() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("t", "up", "space")
            assert stage.station.stops == 1

    play(story)
